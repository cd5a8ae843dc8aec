"""Settings of on-policy training."""

from dataclasses import dataclass, fields

from iwalker_jax.checks import require_plain_numbers, require_whole
from iwalker_jax.errors import InputError
from iwalker_jax.optimization import UnicycleParameters
from iwalker_jax.planning import MemoryIPathConfig
from iwalker_jax.surrogate import FieldParameters, SurrogateParameters


@dataclass(frozen=True)
class PathWeights:
    """Weights of a candidate's terms; the cost is in metres of way in the open.

    Attributes:
        turn: [m] of turning round on the spot to begin the path.
        bend: [1/m] squared second differences of the waypoints.
        tracking: [1/m^2] MSE between the path and its unicycle optimum (eq. 4 of the paper), through the optimum's
            implicit gradient; of every `tracking_every`-th view alone.
        tracking_every: views.
        cost: of the error of the predicted cost; fear: of the predicted contact.
        temperature: [m] of cost by which the candidates share what they learn: the best one learns most.
        compressed_from: [m] of cost above which it counts logarithmically.
    """

    turn: float = 0.3
    bend: float = 1.0
    tracking: float = 10.0
    tracking_every: int = 8
    cost: float = 0.5
    fear: float = 0.2
    temperature: float = 0.05
    compressed_from: float = 3.0

    def __post_init__(self) -> None:
        require_plain_numbers(self)
        require_whole(self.tracking_every, "PathWeights.tracking_every")
        if any(not getattr(self, field.name) >= 0 for field in fields(self)):
            raise InputError("Path weights must be finite and not negative.")
        if not (self.temperature > 0 and self.compressed_from > 0 and self.tracking_every >= 1):
            raise InputError("PathWeights needs temperature and compressed_from > 0 [m] and tracking_every >= 1.")


@dataclass(frozen=True)
class OnPolicyConfig:
    """A training run.

    Attributes:
        network: its size.
        robot: of the surrogate walk.
        grids: of the true fields.
        unicycle: the path MPC.
        weights: of the losses.
        scenes: that are walked in; seed: of everything.
        robots: that walk at a time; steps: of each in a round.
        rounds: of walking and learning in turn.
        epochs: over a round's views; batch: views of a step of Adam.
        learning_rate: at the start; it falls along a cosine.
        weight_decay, clip: of AdamW, and the largest norm of its gradient.
        explore: probability of a candidate at random, at the start; it falls to zero.
        spread: share of what all candidates learn alike, at the start; it falls to a tenth.
    """

    network: MemoryIPathConfig = MemoryIPathConfig()
    robot: SurrogateParameters = SurrogateParameters()
    grids: FieldParameters = FieldParameters()
    unicycle: UnicycleParameters = UnicycleParameters()
    weights: PathWeights = PathWeights()
    scenes: int = 960
    seed: int = 0
    robots: int = 768
    steps: int = 8
    rounds: int = 100
    epochs: int = 4
    batch: int = 256
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    clip: float = 1.0
    explore: float = 0.1
    spread: float = 0.3

    def __post_init__(self) -> None:
        for name in ("scenes", "robots", "steps", "rounds", "epochs", "batch"):
            require_whole(getattr(self, name), f"OnPolicyConfig.{name}")
            if getattr(self, name) < 1:
                raise InputError(f"OnPolicyConfig.{name} must be at least 1.")
        if self.batch > self.robots * self.steps:
            raise InputError("A round of OnPolicyConfig needs at least one batch: robots * steps >= batch.")
        if not (self.learning_rate > 0 and self.clip > 0 and self.weight_decay >= 0):
            raise InputError("OnPolicyConfig needs learning_rate and clip > 0 and weight_decay >= 0.")
        if not (0 <= self.explore <= 1 and 0 <= self.spread <= 1):
            raise InputError("OnPolicyConfig needs explore and spread in [0, 1].")

    @property
    def batches(self) -> int:
        """Steps of Adam in an epoch; views that are left over are not used."""
        return self.robots * self.steps // self.batch
