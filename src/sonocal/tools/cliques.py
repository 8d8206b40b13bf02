"""Sets of which all are joined with all, the largest first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["largest_cliques"]

# Steps of the search, after which it takes what it has.
MOST_STEPS = 20_000


def largest_cliques(joined: NDArray[np.bool_], label: Sequence[int], most: int) -> Iterator[tuple[int, ...]]:
    """Sets of nodes that no node can join, those with most labels first.

    Args:
        joined: (N, N), symmetric.
        label: of each node; of sets as many labels as possible are asked for, then as many nodes.
        most: so many of them.

    Source: Bron and Kerbosch 1973, with a pivot.
    """
    neighbours = [frozenset(np.flatnonzero(row).tolist()) for row in joined]
    found: list[tuple[int, ...]] = []
    stack: list[tuple[tuple[int, ...], frozenset[int], frozenset[int]]] = [
        ((), frozenset(range(len(neighbours))), frozenset())
    ]
    steps = 0
    while stack and steps < MOST_STEPS:
        steps += 1
        chosen, possible, tried = stack.pop()
        if not possible and not tried:
            found.append(chosen)
            continue
        if not possible:
            continue
        pivot = max(possible | tried, key=lambda n: len(neighbours[n] & possible))
        for node in sorted(possible - neighbours[pivot]):
            stack.append(((*chosen, node), possible & neighbours[node], tried & neighbours[node]))
            possible, tried = possible - {node}, tried | {node}
    found.sort(key=lambda one: (-len({label[n] for n in one}), -len(one)))
    yield from found[:most]
