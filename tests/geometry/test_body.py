"""The body's radius and its margins: one home, whose sums are the numbers that every part reckons with."""

import pytest

from iwalker_jax.data.path_sampling import CameraPathSampling
from iwalker_jax.errors import InputError
from iwalker_jax.geometry.body import BODY, BodyParameters
from iwalker_jax.navigation.guide import GuidanceParameters
from iwalker_jax.navigation.path_band import BandParameters
from iwalker_jax.perception.traversal import TraversalParameters
from iwalker_jax.scenes.routes import RouteParameters


def test_every_part_reckons_with_the_bodys_radius_and_its_margin():
    """Oracle: the sums by hand, to the last bit."""
    assert TraversalParameters().body_radius == BODY.radius == 0.18
    assert BODY.layout_radius == 0.15
    assert RouteParameters().inflated_radius == CameraPathSampling().min_clearance == BODY.route_radius == 0.2
    assert GuidanceParameters().traversal.body_radius == 0.2
    assert GuidanceParameters().required_clearance == BODY.gap_radius == 0.195
    assert BandParameters().min_clearance == BODY.radius


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"radius": 0.0}, "radius > 0"),
        ({"layout_margin": -0.2}, r"radius \+ layout_margin > 0"),
        ({"gap_margin": -0.01}, "0 <= gap_margin <= route_margin"),
        ({"gap_margin": 0.05}, "0 <= gap_margin <= route_margin"),
        ({"step_over": 0.0}, "step_over > 0"),
    ],
)
def test_bodies_that_cannot_be_are_refused(changes, sentence):
    with pytest.raises(InputError, match=sentence):
        BodyParameters(**changes)
