"""Orbits and gains of the hybrid linear inverted pendulum: python examples/hlip_orbits.py [--speed 0.3].

Just before each impact the pendulum's state in one plane is x = [p, v], p the COM [m] from the stance foot and v its
velocity [m/s]. A periodic orbit repeats x with step size u; feedback u + K (x - x*) brings a pushed pendulum back.
"""

import iwalker_jax as iw

iw.configure_runtime()

import jax.numpy as jnp
import tyro

from iwalker_jax.optimization import deadbeat_gain, lqr_gain, orbit_p1, orbit_p2, step_matrices


def main(speed: float = 0.3, width: float = 0.1) -> None:
    """Print BRUCE's orbits and let both gains answer a push.

    Args:
        speed: [m/s] forward, of the period-one orbit.
        width: [m] between the feet's tracks, of the period-two orbit.
    """
    pendulum = iw.HlipParameters()
    position, velocity, step = orbit_p1(pendulum, jnp.asarray(speed))
    print(f"Period one, {speed:g} m/s: p {position:.4f} m, v {velocity:.4f} m/s, step {step:.4f} m")
    left, right = (orbit_p2(pendulum, jnp.asarray(s * width), jnp.asarray(-s * width)) for s in (1.0, -1.0))
    print(f"Period two, {width:g} m wide: v {left[1]:+.4f} m/s before a left step, {right[1]:+.4f} m/s before a right")

    matrix, column = step_matrices(pendulum)
    gains = {"deadbeat": deadbeat_gain(pendulum), "LQR": lqr_gain(pendulum, jnp.asarray([1.0, 0.1]), jnp.asarray(1.0))}
    for name, gain in gains.items():
        error = jnp.asarray([0.0, 0.0, 0.2])  # [c, p, v] off the orbit: pushed by 0.2 m/s
        speeds = []
        for _ in range(4):
            error = matrix @ error + column * (gain @ error[1:])
            speeds.append(f"{float(error[2]):+.3f}")
        print(f"{name:8} gain {[round(float(k), 3) for k in gain]}: velocity error after each step {', '.join(speeds)}")


if __name__ == "__main__":
    tyro.cli(main)
