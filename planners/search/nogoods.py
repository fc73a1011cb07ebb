"""Nogoods: sets of candidates under one stance that were refuted by cuts in space, and so close
every part within them.

P1 may admit a choice of patches of which one stance alone cannot be held: its lift is not tight
there. Cuts in space (``cuts``) refute such a stance in a few small programs of one frame; the
refuted choice is then widened, limb by limb, to all candidates for which it stands. A nogood closes
nodes of the search over choices, guides its dive, and stands in the certificate as the subtree that
proves it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from ..equilibrium.layout import Index
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Scaled
from ..files.arrays import Array
from .answer import Clock
from .cuts import PROVABLE, CutSearch, Node, alone, of_stance

NODES = 120
"""Most nodes of the search whether a stance can be held."""
_WIDER_LEAST = 8
"""A widened one may take the nodes that it took before times the most candidates of a limb let in,
and so many more."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Nogood:
    """Candidates of a stance's footholds none of which can hold it: refuted, (P, options), 1 also
    elsewhere.

    Arguments:
        root: of the search that says so, over those candidates alone.
    """

    stance: int
    refuted: Array
    root: Node


class Nogoods:
    """The nogoods found so far on one problem."""

    def __init__(self, programs: Programs, scaled: Scaled, clock: Clock) -> None:
        self._programs, self._scaled, self._clock = programs, scaled, clock
        self._known: set[tuple[int, ...]] = set()
        self.entries: list[_Nogood] = []
        self.masks = np.zeros((0, scaled.layout.footholds, scaled.options))

    def refuting(self, opened: Array) -> int | None:
        """A nogood that covers these open candidates, shape (P, options), or None."""
        if not self.entries:
            return None
        covers = np.all(self.masks >= (opened > 0.0), axis=(1, 2))
        return int(covers.argmax()) if covers.any() else None

    def learn(self, choice: Index, share: float) -> bool:
        """Look at every stance alone on this choice, (P,); whether one is refuted.

        Arguments:
            share: of the clock's limits, where to stop.
        """
        layout, chosen = self._scaled.layout, self._scaled.chosen(choice)
        learned = False
        for stance, (frame, _) in enumerate(layout.stances):
            under = [layout.holds[frame][limb] for limb in range(layout.limbs)]
            key = (stance, *(int(choice[p]) for p in under))
            if key in self._known:
                continue
            if self._clock.ended(share):
                break
            self._known.add(key)
            root = self._refuted(chosen, stance, NODES, share)
            if root is None:
                continue
            learned = True
            self.entries.append(self._widened(stance, choice, root, share))
            self.masks = np.concatenate([self.masks, self.entries[-1].refuted[None]])
        return learned

    def covering(self, choice: Index, foothold: int) -> Array:
        """Number of nogoods that a choice, (P,), meets with each candidate of one foothold, shape
        (options,).
        """
        inside = self.masks[:, np.arange(len(choice)), choice] > 0.0
        inside[:, foothold] = True
        return np.asarray(self.masks[inside.all(axis=1), foothold].sum(axis=0))

    def blame(self, number: int, opened: Array) -> int | None:
        """A foothold whose open candidates a nogood does not cover, and which has several; None
        without one.
        """
        loose = np.any((opened > 0.0) & (self.masks[number] <= 0.0), axis=1) & (
            opened.sum(axis=1) > 1.0
        )
        return int(loose.argmax()) if loose.any() else None

    def rows(self, number: int, opened: Array) -> tuple[list[tuple[float, ...]], list[Array]]:
        """The subtree of a certificate that proves a nogood at a leaf with these open candidates,
        in preorder.
        """
        entry = self.entries[number]
        _, footholds, contacts = alone(self._scaled, entry.stance)
        tree, multipliers = list[tuple[float, ...]](), list[Array]()

        def walk(node: Node, left: Array) -> None:
            kind, i, j, first, second = node.row
            if kind == 0.0:
                tree.append(node.row)
                multipliers.append(of_stance(self._scaled, entry.stance, node.lift))
                return
            p, r = int(i), int(j)
            if (
                kind in (1.0, 2.0) and left[p, r] <= 0.0
            ):  # nothing of it is here: one child covers the rest
                walk(node.children[1 if kind == 1.0 else 0], left)
            elif kind == 1.0 and left[p].sum() == 1.0:
                walk(node.children[0], left)
            else:
                number = contacts[p] if kind == 3.0 else footholds[p]
                tree.append((kind, float(number), j, first, second))
                on, off = left.copy(), left.copy()
                if kind == 1.0:
                    on[p], off[p, r] = 0.0, 0.0
                    on[p, r] = 1.0
                for child, some in zip(node.children, (on, off), strict=True):
                    walk(child, some)

        walk(entry.root, opened[footholds])
        return tree, multipliers

    def _widened(self, stance: int, choice: Index, root: Node, share: float) -> _Nogood:
        """The refuted choice with every limb's other candidates in, as far as the stance stays
        refuted.
        """
        scaled, layout = self._scaled, self._scaled.layout
        frame, limbs = layout.stances[stance]
        everything, mask = scaled.opened(), np.ones((layout.footholds, scaled.options))
        under = np.array(layout.holds[frame])
        mask[under] = np.eye(scaled.options)[choice[under]]
        idle = [layout.holds[frame][limb] for limb in range(layout.limbs) if limb not in limbs]
        for group in (idle, *([layout.holds[frame][limb]] for limb in limbs)):
            if everything[group].sum() <= len(group) or self._clock.ended(share):
                continue
            wider = mask.copy()
            wider[group] = 1.0
            nodes = int(everything[group].sum(axis=1).max()) * len(root.rows()[0]) + _WIDER_LEAST
            nogood = self._refuted(scaled.only(everything * wider), stance, nodes, share)
            if nogood is not None:
                mask, root = wider, nogood
        return _Nogood(stance=stance, refuted=mask, root=root)

    def _refuted(self, scaled: Scaled, stance: int, nodes: int, share: float) -> Node | None:
        """The root of a search that refutes the stance alone; None where it does not, or not in
        time.
        """
        left_s, solves = self._clock.left(share)
        search = CutSearch(
            self._programs,
            alone(scaled, stance)[0],
            gap=PROVABLE,
            tolerance=0.0,
            max_nodes=nodes,
            deadline=time.perf_counter() + left_s,
            max_solves=solves,
        )
        search.run()
        self._clock.count(search.solves, search.seconds)
        return None if search.found is not None or search.stopped else search.root
