"""The gait and the controller of a robot of another size, from BRUCE's by dynamic similarity.

Two pendulums of heights h and k h do the same under one gravity if lengths scale with k, times and speeds with the
square root of k (the Froude number v^2 / g h is then the same), and forces with the masses' ratio; torques and rates of
angular momentum scale with both. Alexander and Jayes, "A dynamic similarity hypothesis for the gaits of quadrupedal
mammals" (1983).
"""

import dataclasses
import math

from bruce_model.symmetry import all_links
from iwalker_jax.control import GaitParameters, LegEffect, WholeBodyParameters
from iwalker_jax.optimization import HlipParameters, StepMpcWeights, StepReach


def similar_gait(com_height: float) -> GaitParameters:
    """BRUCE's gait for a robot whose COM is so high [m] when it stands."""
    like = GaitParameters()
    k = com_height / float(like.hlip.com_height)
    t = math.sqrt(k)
    effect = like.leg_effect

    def error(position: float, velocity: float) -> tuple[float, float]:
        return k * position, t * velocity

    return GaitParameters(
        hlip=HlipParameters(com_height=com_height, single_support_time=t * float(like.hlip.single_support_time)),
        # Deviations are weighed as before if those of velocities, which grow less, weigh more.
        mpc=StepMpcWeights(orbit_velocity=k * float(like.mpc.orbit_velocity)),
        reach=StepReach(
            sagittal=k * like.reach.sagittal,
            lateral_min=k * like.reach.lateral_min,
            lateral_max=k * like.reach.lateral_max,
        ),
        behind=k * like.behind,
        ahead=k * like.ahead,
        swing_height=k * like.swing_height,
        landing_speed=t * like.landing_speed,
        freeze_time=t * like.freeze_time,
        swing_speed=t * like.swing_speed,
        timing_weight=k**2 * like.timing_weight,
        stand_time=t * like.stand_time,
        shift_time=t * like.shift_time,
        settle_time=t * like.settle_time,
        stop_forward=k * like.stop_forward,
        tip_forward=k * like.tip_forward,
        governor=k * like.governor,
        return_step=k * like.return_step,
        residual_limit=error(*like.residual_limit),
        leg_effect=LegEffect(
            sagittal_full=error(*effect.sagittal_full),
            sagittal_late=error(*effect.sagittal_late),
            lateral_full=error(*effect.lateral_full),
            lateral_late=error(*effect.lateral_late),
            stride_full=(effect.stride_full[0], effect.stride_full[1] / t),
            stride_late=(effect.stride_late[0], effect.stride_late[1] / t),
        ),
        late_touchdown=t * like.late_touchdown,
        descent_speed=t * like.descent_speed,
        width=k * like.width,
        speed=t * like.speed,
    )


def similar_tasks(com_height: float, mass: float) -> WholeBodyParameters:
    """BRUCE's whole-body tasks for a robot of so much mass [kg], whose COM is so high [m] when it stands.

    Gains and the weights of accelerations stay: how exactly a motion is followed is a matter of the machine.
    """
    like = WholeBodyParameters()
    k = com_height / float(GaitParameters().hlip.com_height)
    m = mass / sum(link.mass for link in all_links())
    return dataclasses.replace(
        like,
        angular_momentum=like.angular_momentum / (m * k) ** 2,
        regularise_force=like.regularise_force / m**2,
        least_force=m * like.least_force,
        largest_force=m * like.largest_force,
    )
