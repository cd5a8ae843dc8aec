"""Every number of the walking controller, with its unit; the defaults walk BRUCE."""

from dataclasses import dataclass

from iwalker_jax.checks import require_range
from iwalker_jax.errors import InputError
from iwalker_jax.optimization import HlipParameters, StepMpcWeights, StepReach


@dataclass(frozen=True)
class LegEffect:
    """How far a massless-leg pendulum mispredicts the pre-impact COM position [m] and velocity [m/s] of this robot.

    A third of BRUCE is leg. The errors hardly vary from step to step and are linear in the step length; the values were
    read off converged walks at 0 to 0.3 m/s and are where the learning of a walk starts from. Predictions made at
    touchdown (`full`) and at the freeze (`late`) differ because the error is far from even in time.

    Attributes:
        sagittal_full, sagittal_late: forward errors when stepping on the spot.
        lateral_full, lateral_late: sideways errors then, outward over the stance foot positive.
        stride_full, stride_late: forward errors per metre of step length.
    """

    sagittal_full: tuple[float, float] = (0.0026, 0.0157)
    sagittal_late: tuple[float, float] = (0.0, 0.0043)
    lateral_full: tuple[float, float] = (0.0018, 0.0219)
    lateral_late: tuple[float, float] = (-0.0002, -0.0010)
    stride_full: tuple[float, float] = (0.14, 0.80)
    stride_late: tuple[float, float] = (0.001, 0.41)


@dataclass(frozen=True)
class GaitParameters:
    """When and where the feet move.

    Attributes:
        hlip: the pendulum, without double support; its single-support time is the nominal step time.
        mpc: weights of the step MPC that corrects the planned footsteps.
        horizon: planned footsteps that the step MPC looks ahead.
        feedback: whether the step MPC corrects the planned footsteps; without it they are taken as planned.
        reach: bounds of one step in the heading frame.
        behind, ahead: how far behind and ahead of the COM a foot may land [m]; the hip hardly extends backwards.
        swing_height: apex of the swing foot above the stance foot [m].
        landing_speed: downward speed of the swing foot at touchdown [m/s]; zero lands early and widens the steps.
        freeze_time: the footstep is no longer changed this long before touchdown [s].
        swing_speed: largest mean horizontal speed asked of the swing foot [m/s].
        fastest: shortest remaining time, as a share of the nominal one, that step timing may choose.
        slowest: longest such share.
        timing_weight: price of (share - 1)^2 against squared metres out of reach [m^2].
        stand_time: time of standing before a walk starts [s].
        shift_time: time in which the COM moves towards the first stance foot [s].
        settle_time: time it then waits there [s].
        stop_forward: to stop, the divergent component must be less than this ahead of or behind the feet [m], and
        stop_sideways: less than this share of the way from the middle to either foot.
        tip_forward, tip_sideways: a standing robot steps at once when it is farther ahead or behind [m], or by this
            share of that way outside the feet.
        governor: deviation of a footstep from the plan beyond which the plan itself moves [m].
        return_step: how far a moved plan returns towards its place in one step [m].
        residual_rate: share of the pendulum's newest prediction error that is learned at each step.
        residual_limit: bound of the learned error, position [m] and velocity [m/s].
        leg_effect: what the learning starts from.
        late_touchdown: a swing foot that has not met the floor in time goes on down for this long [s].
        descent_speed: at which it does [m/s].
        early_touchdown: whether a foot that touches the floor in the second half of its swing ends the step.
        width: [m] between the tracks of the two feet, and
        speed: [m/s] of walks that do not say theirs.
    """

    hlip: HlipParameters = HlipParameters()
    mpc: StepMpcWeights = StepMpcWeights()
    horizon: int = 6
    feedback: bool = True
    reach: StepReach = StepReach(sagittal=0.30, lateral_min=0.045, lateral_max=0.26)
    behind: float = 0.16
    ahead: float = 0.28
    swing_height: float = 0.028
    landing_speed: float = 0.1
    freeze_time: float = 0.03
    swing_speed: float = 1.6
    fastest: float = 0.4
    slowest: float = 1.15
    timing_weight: float = 1e-3
    stand_time: float = 0.3
    shift_time: float = 0.5
    settle_time: float = 0.4
    stop_forward: float = 0.035
    stop_sideways: float = 0.8
    tip_forward: float = 0.045
    tip_sideways: float = 0.0
    governor: float = 0.03
    return_step: float = 0.01
    residual_rate: float = 0.3
    residual_limit: tuple[float, float] = (0.02, 0.12)
    leg_effect: LegEffect = LegEffect()
    late_touchdown: float = 0.08
    descent_speed: float = 0.3
    early_touchdown: bool = False
    width: float = 0.10
    speed: float = 0.15

    def __post_init__(self) -> None:
        if self.hlip.double_support_time != 0:
            raise InputError(
                f"The gait changes feet at once, but its pendulum has {self.hlip.double_support_time} s of double "
                "support; give a double_support_time of 0."
            )
        if not 2 <= self.horizon <= 20:
            raise InputError(f"GaitParameters.horizon is {self.horizon}; look 2 to 20 footsteps ahead.")
        require_range(self, "swing_height", 0.005, 0.2, "m")
        require_range(self, "landing_speed", 0.0, 1.0, "m/s")
        require_range(self, "freeze_time", 0.0, 0.2, "s")
        require_range(self, "swing_speed", 0.1, 20.0, "m/s")
        require_range(self, "fastest", 0.05, 1.0, "of the nominal time")
        require_range(self, "slowest", 1.0, 3.0, "of the nominal time")
        require_range(self, "shift_time", 0.05, 10.0, "s")
        require_range(self, "residual_rate", 0.0, 1.0, "")
        if self.tip_forward < self.stop_forward or self.tip_sideways < self.stop_sideways - 1:
            raise InputError(
                "A robot that stops must not tip: give tip_forward >= stop_forward, tip_sideways >= stop_sideways - 1."
            )


@dataclass(frozen=True)
class WholeBodyParameters:
    """Weights and gains of the whole-body tasks; accelerations [m/s^2, rad/s^2], gains kp [1/s^2] and kd [1/s].

    Attributes:
        stance, stance_angular: weights of the stance feet's linear and angular accelerations, which are only damped.
        torso_tilt, torso_yaw: orientation of the base about its horizontal axes and about the vertical.
        com_height: vertical COM motion.
        com_horizontal: pendulum acceleration of the COM in the plane.
        swing_position, swing_orientation: swing foot; its roll is free, because the ankle cannot roll.
        angular_momentum: rate of the centroidal angular momentum towards zero, kd alone [1/s].
        arm_kp, arm_kd: the arms' posture accelerations.
        regularise_acceleration, regularise_force: towards zero and towards an even share of the weight.
        capture_gain: standing, how fast the divergent component is pulled to its place, in pendulum rates.
        friction: coefficient that the contact forces respect.
        least_force, largest_force: vertical force of a contact in stance [N].
    """

    stance: float = 200.0
    stance_angular: float = 1.0
    stance_kd: float = 30.0
    torso_tilt: float = 10.0
    torso_tilt_kp: float = 600.0
    torso_tilt_kd: float = 45.0
    torso_yaw: float = 1.0
    torso_yaw_kp: float = 200.0
    torso_yaw_kd: float = 25.0
    com_height: float = 400.0
    com_height_kp: float = 150.0
    com_height_kd: float = 20.0
    com_horizontal: float = 30.0
    swing_position: float = 50.0
    swing_position_kp: float = 600.0
    swing_position_kd: float = 45.0
    swing_orientation: float = 2.0
    swing_orientation_kp: float = 200.0
    swing_orientation_kd: float = 25.0
    angular_momentum: float = 0.02
    angular_momentum_kd: float = 10.0
    arm_kp: float = 60.0
    arm_kd: float = 12.0
    regularise_acceleration: float = 1e-2
    regularise_force: float = 1e-2
    capture_gain: float = 1.0
    friction: float = 0.5
    least_force: float = 1.0
    largest_force: float = 100.0

    def __post_init__(self) -> None:
        require_range(self, "friction", 0.01, 5.0, "")
        require_range(self, "regularise_acceleration", 1e-6, 1e3, "")
        require_range(self, "regularise_force", 1e-6, 1e3, "")
        if not 0 <= self.least_force < self.largest_force:
            raise InputError(
                f"Contact forces lie in [{self.least_force}, {self.largest_force}] N; give 0 <= least < largest."
            )
