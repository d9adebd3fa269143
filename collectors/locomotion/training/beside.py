"""Two networks as one."""

import numpy as np

from ....formats.core.arrays import Array


def beside(
    gait: tuple[list[Array], list[Array]], correction: tuple[list[Array], list[Array]]
) -> tuple[list[Array], list[Array]]:
    """Return the layers of the sum of two networks, of which the first sees less."""
    (own, *_, own_last), (other, *_, other_last) = gait[0], correction[0]
    inputs = other.shape[1] - own.shape[1]
    weights = [np.vstack([np.pad(own, ((0, 0), (0, inputs))), other])]
    for a, b in zip(gait[0][1:-1], correction[0][1:-1], strict=True):
        weights.append(
            np.block([[a, np.zeros((len(a), b.shape[1]))], [np.zeros((len(b), a.shape[1])), b]])
        )
    weights.append(np.hstack([own_last, other_last]))
    hidden = [np.concatenate(pair) for pair in zip(gait[1][:-1], correction[1][:-1], strict=True)]
    return weights, [*hidden, gait[1][-1] + correction[1][-1]]
