"""The robot that walks on a footstep plan: roll-outs of one robot or many, on MJX or on C MuJoCo."""
