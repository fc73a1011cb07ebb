#!/bin/sh
# Steps as a graph of convex sets of Drake's, where no way over the stones is possible.
#
# Seen with Drake 1.51.1, Clarabel: a foot goes from a stone on the left or one on the right straight ahead over a plate onto a
# beam. With the beam in the middle no way is possible, and there are two, which are both tried. SolveShortestPath with a
# rounded relaxation says kIterationLimit, with 200 iterations allowed and with 20,000 just the same. Without rounding the
# relaxation alone is kSolutionFound, with half a foot on each stone. With the beam on the left there is a way, and it is found.
#
# Guess beforehand: kIterationLimit says that the solver ran out of its iterations, so more of them, or looser tolerances,
# help; and where all ways were tried in vain, it says infeasible. It speaks of the rounded ways: none of those that were
# tried is possible, and whether it was all of them, or only the first ten of thousands, it does not say.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check --only-binary :all: "drake==1.51.1" "numpy==2.4.6"
cat > stones.py <<'PYTHON'
import logging
import sys
from importlib.metadata import version

from pydrake.geometry.optimization import GraphOfConvexSets, GraphOfConvexSetsOptions, HPolyhedron, Point
from pydrake.solvers import ClarabelSolver, SolverOptions


def said(beam_m, ways, iterations):
    """What Drake says of the way from either stone over the plate to a beam that is so far to the left [m]."""
    graph = GraphOfConvexSets()
    sets = {
        "start": Point([0.0]),
        "left": Point([0.2]),
        "right": Point([-0.2]),
        "plate": HPolyhedron.MakeBox([-0.3], [0.3]),
        "beam": Point([beam_m]),
        "goal": Point([0.0]),
    }
    at = {name: graph.AddVertex(place, name) for name, place in sets.items()}
    for here in ("left", "right"):
        graph.AddEdge(at["start"], at[here])
    for here, there in (("left", "plate"), ("right", "plate"), ("plate", "beam")):
        edge = graph.AddEdge(at[here], at[there])
        edge.AddConstraint(edge.xu()[0] == edge.xv()[0])
    graph.AddEdge(at["beam"], at["goal"])
    limits = SolverOptions()
    limits.SetOption(ClarabelSolver.id(), "max_iter", iterations)
    options = GraphOfConvexSetsOptions()
    options.convex_relaxation = True
    options.max_rounded_paths = ways
    options.solver = ClarabelSolver()
    options.solver_options = options.restriction_solver_options = limits
    return graph.SolveShortestPath(at["start"], at["goal"], options).get_solution_result().name


logging.getLogger("drake").setLevel(logging.WARNING)
print(f"Drake {version('drake')}")
middle = [said(0.0, 10, iterations) for iterations in (200, 20_000)]
relaxed, left = said(0.0, 0, 200), said(0.2, 10, 200)
print("beam in the middle, 200 and 20,000 iterations:", *middle)
print("its relaxation alone:", relaxed, "and a beam on the left:", left)
odd = middle == ["kIterationLimit"] * 2 and relaxed == left == "kSolutionFound"
sys.exit(0 if odd else "something is otherwise now")
PYTHON
env/bin/python stones.py
