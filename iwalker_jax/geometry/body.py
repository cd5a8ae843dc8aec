"""How wide the robot's body is in plan view, and with which margins different parts reckon."""

from dataclasses import dataclass

from iwalker_jax.errors import InputError


@dataclass(frozen=True)
class BodyParameters:
    """The body's footprint, a disc about the base's origin.

    Attributes:
        radius: [m] half the body's width at the elbows; where an obstacle is nearer, the body touches.
        layout_margin: [m] of generated scenes, which offer connected floor to a slightly slimmer body.
        route_margin: [m] of routes, goals and camera poses, for the gait's sway.
        stop_margin: [m] at which a path that comes nearer to an obstacle ends.
    """

    radius: float = 0.18
    layout_margin: float = -0.03
    route_margin: float = 0.02
    stop_margin: float = 0.04

    def __post_init__(self) -> None:
        if not (self.radius > 0 and self.radius + self.layout_margin > 0):
            raise InputError("BodyParameters needs radius > 0 and radius + layout_margin > 0 [m]; correct them.")
        if not 0 <= self.route_margin <= self.stop_margin:
            raise InputError("BodyParameters needs 0 <= route_margin <= stop_margin [m]; correct them.")

    @property
    def layout_radius(self) -> float:
        """[m] that generated scenes leave room for."""
        return _sum(self.radius, self.layout_margin)

    @property
    def route_radius(self) -> float:
        """[m] that routes, goals and camera poses keep from obstacles."""
        return _sum(self.radius, self.route_margin)

    @property
    def stop_radius(self) -> float:
        """[m] nearer than which no path goes on."""
        return _sum(self.radius, self.stop_margin)


def _sum(radius: float, margin: float) -> float:
    # Rounded to a nanometre, so that 0.18 + 0.02 is 0.2 and not the number before it.
    return round(radius + margin, 9)


BODY = BodyParameters()
"""BRUCE's."""
