"""Mount, unit, orientation and intrinsics that are not those of the images."""

import numpy as np

from tests.data.recording_folders import HEIGHT, PITCH, WIDTH
from tests.malformed.drafts import FLOORS, Draft, image_name, png, yaml_draft


def wrong_mount(rng: np.random.Generator) -> Draft:
    draft = yaml_draft(rng, mount=True)
    key, value = [
        ("height", 0.6 * rng.uniform(1.3, 3.0)),
        ("height", 0.6 * rng.uniform(0.1, 0.75)),
        ("height", 60.0),
        ("height", 600.0),
        ("height", -0.6),
        ("pitch_deg", float(PITCH)),
        ("pitch_deg", -20.0),
        ("pitch_deg", 20.0 + rng.choice([-1, 1]) * rng.uniform(10, 60)),
        ("roll_deg", 6.0 + rng.choice([-1, 1]) * rng.uniform(10, 50)),
        ("roll_deg", 180.0),
        ("forward", 30.0),
        ("left", -400.0),
    ][rng.integers(12)]
    draft.content["mount"][key] = float(value)
    return draft


def wrong_scale(rng: np.random.Generator) -> Draft:
    draft = yaml_draft(rng)
    factor = float(rng.choice([0.001, 0.1, 0.2, 0.25, 0.5, 2, 3, 4, 5, 10, 100, 1000, 1e6]))
    draft.content["depth_scale"] = 0.001 * factor
    draft.expected = "refused" if "mount" in draft.content else "doubted"
    if rng.random() < 0.3 and factor in (0.2, 0.25, 4, 5, 10):  # the images instead of the number
        del draft.content["depth_scale"]
        units = [np.minimum(image * factor, 65535).astype(np.uint16) for image in FLOORS]
        draft.files |= {image_name(k): png(unit) for k, unit in enumerate(units)}
    return draft


def turned_images(rng: np.random.Generator) -> Draft:
    draft = yaml_draft(rng)
    turn = int(rng.integers(1, 4))
    how = rng.integers(3)
    change = [
        lambda image: np.rot90(image, turn),
        lambda image: image[::-1],
        lambda image: image.byteswap(),
    ][how]
    draft.files |= {image_name(k): png(change(image)) for k, image in enumerate(FLOORS)}
    if how == 0 and turn != 2:
        draft.content["intrinsics"] = {"width": HEIGHT, "height": WIDTH, "fx": 60.0, "fy": 60.0, "cx": 44.5, "cy": 59.5}
    draft.expected = "refused" if "mount" in draft.content else "doubted"
    return draft


def wrong_intrinsics(rng: np.random.Generator) -> Draft:
    draft = yaml_draft(rng, mount=True)
    K = draft.content["intrinsics"]
    factor = float(rng.choice([0.25, 0.5, 2 / 3, 1.5, 2.0, 4.0]))
    how = rng.integers(6)
    if how == 0:  # of another resolution, with this one's size
        K |= {key: K[key] * factor for key in ("fx", "fy", "cx", "cy")}
    elif how == 1:  # of another resolution
        K |= {key: K[key] * factor for key in K} | {key: int(K[key] * factor) for key in ("width", "height")}
    elif how == 2:
        K |= {"fx": K["fx"] * factor, "fy": K["fy"] * factor}
    elif how == 3:
        K |= {"width": K["height"], "height": K["width"]}
    elif how == 4:
        K |= {"width": int(10 ** rng.uniform(4, 18)), "height": 90}
    else:
        K |= {"cx": K["cy"], "cy": K["cx"]}
    return draft
