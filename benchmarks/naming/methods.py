"""Three general methods on the same terms, and Hysteron on the data set: which effects does each name?

Each general method gets the residual of the nominal model on the fitted records and all candidate terms, scaled to a standard deviation of one, and gives
the terms that it picks with their coefficients. From there on all are treated alike (`named`): what each effect adds is the sum of its terms; an effect is named
where leaving that out raises the held-out error by more than one part in forty, and the first name is the one that is missed most. Where the picked terms together do not lower the held-out
error by one part in forty, nothing is named.
"""

import itertools
import json
import re
import resource
import subprocess

import numpy as np

from terms import MEANS

MATTERS = 1.0 / 40.0


def named(picked, fitted, held_out):
    """Groups of effects, the one that is missed most first. `picked` holds columns; their coefficients are fitted again by least squares."""
    if not picked:
        return []
    weights, *_ = np.linalg.lstsq(fitted["terms"][:, picked], fitted["residual"], rcond=None)
    left = held_out["residual"] - held_out["terms"][:, picked] @ weights
    rms = lambda x: np.sqrt(np.mean(x**2))
    if rms(left) > (1.0 - MATTERS) * rms(held_out["residual"]):
        return []
    names = list(MEANS)
    groups = {}
    for column, weight in zip(picked, weights):
        groups.setdefault(MEANS[names[column]], []).append((column, weight))
    raised = {}
    for effects, parts in groups.items():
        without = left + sum(held_out["terms"][:, column] * weight for column, weight in parts)
        raised[effects] = rms(without) / rms(left) - 1.0
    order = sorted(raised, key=raised.get, reverse=True)
    return [list(effects) for effects in order if raised[effects] > MATTERS]


def sindy(fitted, held_out):
    """Sequentially thresholded ridge regression; of several weights of the ridge and thresholds those whose model leaves least of the held-out records, the sparser of
    two that leave the same within one part in forty. The package's own weight is 0.05."""
    import pysindy

    scale = np.std(fitted["residual"]) or 1.0
    found = []
    for alpha, threshold in itertools.product((100.0, 10.0, 1.0, 0.05), (1.0, 0.5, 0.2, 0.1, 0.05, 0.02)):
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=alpha, max_iter=50)
        optimizer.fit(fitted["terms"], (fitted["residual"] / scale)[:, None])
        picked = [int(i) for i in np.flatnonzero(np.abs(optimizer.coef_[0]) > 0.0)]
        if not picked:
            continue
        left = held_out["residual"] / scale - held_out["terms"] @ optimizer.coef_[0]
        error = float(np.sqrt(np.mean(left**2)))
        found.append((error, len(picked), picked))
    if not found:
        return []
    least = min(error for error, _, _ in found)
    return min((one for one in found if one[0] <= least / (1.0 - MATTERS)), key=lambda one: one[1])[2]


def frols(fitted, _held_out):
    """Forward regression by error reduction ratios, as many terms as the Bayesian information criterion asks for."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    count = fitted["terms"].shape[1]
    model = FROLS(
        order_selection=True,
        n_info_values=12,
        info_criteria="bic",
        xlag=[[1]] * count,
        ylag=1,
        model_type="NFIR",
        basis_function=Polynomial(degree=1),
        estimator=LeastSquares(),
    )
    # The method looks at the sample before: the terms are put one sample ahead.
    inputs = np.vstack([fitted["terms"][1:], fitted["terms"][-1:]])
    model.fit(X=inputs, y=fitted["residual"][:, None])
    # A regressor's code: 1000 times the signal (1 the output, 2 the first input) and its lag.
    codes = [int(code) for row in np.atleast_2d(model.final_model) for code in row if code >= 2000]
    return sorted({code // 1000 - 2 for code in codes})


def operon(fitted, _held_out):
    """Genetic programming of expressions; the variables of the best one."""
    from pyoperon.sklearn import SymbolicRegressor

    regressor = SymbolicRegressor(
        allowed_symbols="add,sub,mul,constant,variable",
        population_size=500,
        generations=200,
        max_length=25,
        max_time=12,
        n_threads=2,
        random_state=1,
    )
    regressor.fit(fitted["terms"], fitted["residual"])
    text = regressor.get_model_string(regressor.model_, 6)
    return sorted({int(number) - 1 for number in re.findall(r"X(\d+)", text)})


def hysteron(program, model, folder, out):
    """`hysteron diagnose`: its findings, each a group that the data do not distinguish, and other values of effects that are there."""
    used = lambda: sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
    before = used()
    subprocess.run([program, "diagnose", model, folder, "--json", out, "--force"], check=True, capture_output=True)
    seconds = used() - before
    with open(out, encoding="utf-8") as file:
        written = json.load(file)
    found = written.get("diagnosis", written)
    groups = [finding["effects"] for finding in found["findings"]] if found["verdict"] in ("named", "ambiguous", "undecidable") else []
    changed = dict.fromkeys(one["effect"] for one in found["changed"])
    groups += [[effect] for effect in changed if [effect] not in groups]
    groups += [["readings that end"]] if any("readings" in said for said in found["recording"]) else []
    return groups, seconds


GENERAL = {"PySINDy, STLSQ": sindy, "SysIdentPy, FROLS": frols, "Operon, symbolic regression": operon}
