"""What checks the library's annotations when tests call it: beartype, for which NumPy's scalars are numbers too."""

import numpy as np
from beartype import BeartypeConf, BeartypeHintOverrides, beartype

checked = beartype(
    conf=BeartypeConf(
        hint_overrides=BeartypeHintOverrides(
            {
                bool: bool | np.bool_,
                int: int | np.integer,
                float: float | int | np.floating | np.integer,
            }
        )
    )
)
