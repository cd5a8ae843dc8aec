"""The world, which knows no robot: solids, routes among them, rays, depth noise, export to MuJoCo."""
