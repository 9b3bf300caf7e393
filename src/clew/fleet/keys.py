"""Keys of many robots in one graph: the robot's letter in the top byte, as gtsam's symbols have it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.graph import FactorGraph

Index = NDArray[np.int64]

SHIFT = 56
LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"


def separate_keys(graphs: Sequence[FactorGraph], names: Sequence[str]) -> list[tuple[Index, Index]]:
    """Old and new keys of each robot's variables, old ones ascending; no two robots share a new key.

    Robots whose keys carry letters that no other robot uses keep their keys; plain keys get a letter of their
    own.

    Raises:
        InputError: more robots than letters, or two robots whose keys carry the same letter.
    """
    olds = [np.sort(graph.keys()) for graph in graphs]
    used = [set(np.unique(old >> SHIFT).tolist()) for old in olds]
    taken: set[int] = set().union(*used) - {0}
    free = iter([ord(letter) for letter in LETTERS if ord(letter) not in taken])
    tables = []
    for robot, (old, letters) in enumerate(zip(olds, used, strict=True)):
        for other in range(robot):
            both = (letters & used[other]) - {0}
            if both:
                raise InputError(f"robots {names[other]} and {names[robot]}: keys of both carry the letter "
                                 f"{chr(min(both))!r} in their top byte; rename one of them")
        letter = next(free, None) if 0 in letters else 0
        if letter is None:
            raise InputError(f"{len(graphs)} robots: more than there are letters ({len(LETTERS)}); merge in stages")
        tables.append((old, np.where(old >> SHIFT == 0, old | (letter << SHIFT), old)))
    return tables


def translate(table: tuple[Index, Index], keys: Index) -> Index:
    """New keys for old ones (all known)."""
    old, new = table
    return np.asarray(new[np.searchsorted(old, keys)])
