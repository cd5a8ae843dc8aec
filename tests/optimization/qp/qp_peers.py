"""Independent solutions of quadratic programs: Clarabel's interior point, in double precision."""

import clarabel
import numpy as np
import scipy.sparse as sparse


def clarabel_solution(P, q, C, low, high) -> np.ndarray:
    """x of min x'P x / 2 + q'x with low <= C x <= high."""
    P, q, C, low, high = (np.asarray(a, float) for a in (P, q, C, low, high))
    equal = low == high
    above, below = np.isfinite(high) & ~equal, np.isfinite(low) & ~equal
    rows = sparse.csc_matrix(np.concatenate([C[equal], C[above], -C[below]]))
    bounds = np.concatenate([high[equal], high[above], -low[below]])
    cones = [clarabel.ZeroConeT(int(equal.sum())), clarabel.NonnegativeConeT(int(above.sum() + below.sum()))]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    return np.asarray(clarabel.DefaultSolver(sparse.csc_matrix(np.triu(P)), q, rows, bounds, cones, settings).solve().x)
