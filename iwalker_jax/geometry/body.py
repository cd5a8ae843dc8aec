"""How wide the robot's body is in plan view, with which margins different parts reckon, and what it may step on."""

from dataclasses import dataclass

from iwalker_jax.errors import InputError


@dataclass(frozen=True)
class BodyParameters:
    """The body's footprint, a disc about the base's origin, and the height of its steps.

    Attributes:
        radius: [m] half the body's width at the elbows; where an obstacle is nearer, the body touches.
        layout_margin: [m] of generated scenes, which offer connected floor to a slightly slimmer body.
        route_margin: [m] of routes, goals and camera poses, for the gait's sway.
        gap_margin: [m] of the tightest gap that is walked through, as the map shows it: for the sway.
        step_over: [m] what ends at this height or below is floor, for the map as for collisions and conversions: the
            swing foot clears it. What is higher is an obstacle.
    """

    radius: float = 0.18
    layout_margin: float = -0.03
    route_margin: float = 0.02
    gap_margin: float = 0.015
    step_over: float = 0.025

    def __post_init__(self) -> None:
        if not (self.radius > 0 and self.radius + self.layout_margin > 0):
            raise InputError("BodyParameters needs radius > 0 and radius + layout_margin > 0 [m]; correct them.")
        if not self.step_over > 0:
            raise InputError("BodyParameters needs step_over > 0 [m]; correct it.")
        if not 0 <= self.gap_margin <= self.route_margin:
            raise InputError("BodyParameters needs 0 <= gap_margin <= route_margin [m]; correct them.")

    @property
    def layout_radius(self) -> float:
        """[m] that generated scenes leave room for."""
        return _sum(self.radius, self.layout_margin)

    @property
    def route_radius(self) -> float:
        """[m] that routes, goals and camera poses keep from obstacles."""
        return _sum(self.radius, self.route_margin)

    @property
    def gap_radius(self) -> float:
        """[m] nearer than which no route leads on."""
        return _sum(self.radius, self.gap_margin)


def _sum(radius: float, margin: float) -> float:
    # Rounded to a nanometre, so that 0.18 + 0.02 is 0.2 and not the number before it.
    return round(radius + margin, 9)


BODY = BodyParameters()
"""BRUCE's."""
