"""Errors common to all frames: scale of depth, turn and principal point of the camera; their probability."""

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

COMMON = 6
"""Number of common errors: logarithm of depth's scale, turn (3,) and centre (2,)."""
_ODDS = 0.5
"""Prior odds that a camera deviates from what it states: one in three does."""
# Directions with less information than this, relative to the largest, are known by rounding and not by depth.
_UNTOLD = 1e-9
# Share of the prior's information that keeps the most probable errors finite where nothing was observed.
_RIDGE = 1e-6


class Equations(NamedTuple):
    """Log likelihood of the observations, given the errors w (n,) of the given poses and z (m,) common to all frames:
    pull @ w + drawn @ z - w @ held @ w / 2 - w @ across @ z - z @ shared @ z / 2.

    held: (n, n), across: (n, m), pull: (n,), w in units of the stated uncertainty; shared: (m, m), drawn: (m,).
    """

    held: NDArray[np.float64]
    across: NDArray[np.float64]
    pull: NDArray[np.float64]
    shared: NDArray[np.float64]
    drawn: NDArray[np.float64]


class CommonErrors(NamedTuple):
    """Log likelihood of the free common errors c, for each of s variances that the given poses may have: evidence +
    pull @ c - c @ information @ c / 2.

    free: (k,) indices of the free errors, the others have their nominal value; sigmas: (k,) prior standard deviations;
    evidence: (s,); pull: (s, k); information: (s, k, k). apart: share of the evidence for a variance that is
    independent; share: share of the information on the errors that is trusted.
    """

    free: NDArray[np.int64]
    sigmas: NDArray[np.float64]
    evidence: NDArray[np.float64]
    pull: NDArray[np.float64]
    information: NDArray[np.float64]
    apart: float = 1.0
    share: float = 1.0


def marginal(
    seen: Equations, kept: int, variances: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Evidence (s,), pull (s, kept) and information (s, kept, kept), as in `CommonErrors`, of the first `kept` common
    errors, for each variance (s,) of the given poses. The poses' errors and the other common ones are marginalised out.
    """
    known, axes = np.linalg.eigh(seen.held)
    told = known > _UNTOLD * known[-1]
    known, axes = known[told], axes[:, told]
    across, pull = axes.T @ seen.across, axes.T @ seen.pull
    count = len(variances)
    evidence, pulls, information = np.empty(count), np.empty((count, kept)), np.empty((count, kept, kept))
    for number, variance in enumerate(variances):
        explained = variance / (1 + variance * known)
        H = seen.shared - across.T @ (explained[:, None] * across)
        g = seen.drawn - across.T @ (explained * pull)
        own, aside = H[:kept, kept:], H[kept:, kept:]
        solved = np.linalg.solve(aside, np.column_stack((own.T, g[kept:])))
        evidence[number] = explained @ pull**2 - np.log1p(variance * known).sum()
        evidence[number] += g[kept:] @ solved[:, -1] - np.linalg.slogdet(aside)[1]
        pulls[number] = g[:kept] - own @ solved[:, -1]
        information[number] = H[:kept, :kept] - own @ solved[:, :-1]
    return 0.5 * evidence, pulls, information


def most_probable(errors: CommonErrors) -> int:
    """Index of the most probable variance of the given poses, summed over two models: all errors free, or all zero."""
    every, nothing = np.arange(len(errors.free)), np.zeros(len(errors.free))
    models = (_model(errors, there, nothing, errors.share)[0] for there in (every[:0], every))
    return int(np.argmax(np.logaddexp(*models)))


def believed(
    errors: CommonErrors, asked: NDArray[np.int64], known: NDArray[np.float64], share: float = 1.0
) -> NDArray[np.float64]:
    """The correction to apply for the free errors `asked` for (n,): their mean where they are not zero, times the
    probability that they are not; zero where that is at most a half.

    Models where these errors are zero or not, where the others are, and with each variance of the given poses, are
    weighted by the likelihood of the observations (Bayes factors of spikes and slabs: Mitchell and Beauchamp 1988).
    known: (6,) values of the others, nan where unknown; share: factor of `errors.share`.
    """
    wanted, unknown = np.isin(errors.free, asked), np.isnan(known[errors.free])
    own, others = np.flatnonzero(wanted), np.flatnonzero(unknown & ~wanted)
    fixed = np.where(unknown, 0.0, known[errors.free])
    weights, means = list[NDArray[np.float64]](), list[NDArray[np.float64]]()
    for there, with_others in product((False, True), (False, True) if len(others) else (False,)):
        chosen = np.concatenate((own if there else own[:0], others if with_others else others[:0]))
        evidence, mean = _model(errors, chosen, fixed, share * errors.share)
        weights.append(evidence + (there + with_others) * np.log(_ODDS))
        means.append(mean[:, : len(own)] if there else np.zeros((len(evidence), len(own))))
    probable = np.exp(np.array(weights) - np.max(weights))
    probable /= probable.sum()
    if probable[len(probable) // 2 :].sum() <= 0.5:
        return np.zeros(len(own))
    return np.asarray(np.einsum("ms,msn->n", probable, np.array(means)))


def _model(
    errors: CommonErrors, there: NDArray[np.int64], fixed: NDArray[np.float64], share: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Log evidence (s,) and mean errors (s, n) for each variance, where the errors `there` (n,) are free and the others
    have the values `fixed` (k,).
    """
    others = fixed.copy()
    others[there] = 0.0
    base, pull, information = errors.evidence, errors.pull, errors.information
    slab = np.diag(errors.sigmas**-2.0)
    best = 0.5 * (pull * _solved(information + _RIDGE * slab, pull)).sum(axis=1)
    as_fixed = pull @ others - 0.5 * others @ information @ others
    trusted = (share * information + slab)[:, there[:, None], there]
    drawn = share * (pull - information @ others)[:, there]
    mean = _solved(trusted, drawn)
    narrower = np.linalg.slogdet(trusted)[1] + 2 * np.log(errors.sigmas[there]).sum()
    wide = 0.5 * ((drawn * mean).sum(axis=1) - narrower)
    return np.asarray(errors.apart * (base + best) + share * (as_fixed - best) + wide), mean


def _solved(A: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """x (s, n) of A x = b, (s, n, n) and (s, n)."""
    return np.asarray(np.linalg.solve(A, b[:, :, None])[:, :, 0], np.float64)
