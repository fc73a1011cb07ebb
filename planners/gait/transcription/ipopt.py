"""Solving gait programs with IPOPT and MUMPS through CasADi: every iterate is recorded, the first feasible one wins."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np

from ...errors import InvalidInput
from ...files.arrays import Array, checked, frozen
from ..formulation import GaitProgram
from ..solution import GaitSolution

Callback = Callable[[int, float, float], "bool | None"]


@dataclass(frozen=True, kw_only=True)
class Costs:
    """Weights of the objective ½ proximal ‖x − x₁‖² + ½ acceleration ∫… + ½ force_rate ∫… (``terms.cost``)."""

    proximal: float = 0.3
    acceleration: float = 0.0
    force_rate: float = 0.0

    @property
    def smooth(self) -> bool:
        """Whether more than the distance from the reference counts."""
        return self.acceleration > 0.0 or self.force_rate > 0.0


def solve(
    program: GaitProgram,
    guess: Array | None = None,
    callback: Callback | None = None,
    *,
    costs: Costs | None = None,
    reference: Array | None = None,
    height_factor: float = 1.0,
    max_iterations: int | None = None,
    stop_when_feasible: bool = True,
    options: Mapping[str, Any] | None = None,
) -> GaitSolution:
    """Solve from a guess until the first feasible iterate.

    callback(iteration, violation, cost): may return True to stop. costs: weights of the objective; without any, the
    distance from the reference alone keeps the answer near. reference: x₁, the guess if missing. height_factor: on the
    terrain's heights (homotopy), for charts that have no map of their own. stop_when_feasible: else IPOPT goes on to
    its own end or to max_iterations. options: further options of IPOPT. Raises InvalidInput.
    """
    costs = costs or Costs()
    checked(height_factor, "height_factor", least=0.0)
    if height_factor != 1.0 and not program.structure.chart.scales:
        raise InvalidInput(
            f"height_factor: expected 1 in the chart {program.settings.chart}, whose map is for one terrain, "
            f"got {height_factor:g}"
        )
    start = program.guess if guess is None else frozen(guess, (program.size,), "guess")
    parameters = np.concatenate(
        [start if reference is None else frozen(reference, (program.size,), "reference"),
         [costs.proximal, costs.acceleration, costs.force_rate, height_factor]]
    )  # fmt: skip
    limit = program.settings.max_iterations if max_iterations is None else max_iterations
    solver, watch = _solver(program, costs.smooth, limit, dict(options or {}))
    watch.begin(program, callback, stop_when_feasible)
    began = time.process_time()
    solver(x0=start, p=parameters, lbg=program.program.lower, ubg=program.program.upper)
    seconds = time.process_time() - began
    stats = solver.stats()
    evaluating = sum(stats[key] for key in stats if key.startswith("t_proc_nlp_"))
    x, iterations, success = watch.result()
    values = np.asarray(program.program.constraint(x, parameters)).ravel()
    return GaitSolution(
        program=program,
        success=success,
        iterations=iterations,
        history=tuple(watch.history),
        x=frozen(x, (program.size,), "x"),
        violations=program.program.violations(values),
        status=str(stats["return_status"]),
        seconds=seconds,
        seconds_evaluating=evaluating,
        seconds_linear=max(seconds - evaluating, 0.0),
        height_factor=height_factor,
    )


def constraint_values(program: GaitProgram, x: Array, height_factor: float = 1.0) -> Array:
    """g at a decision vector, shape (rows,)."""
    parameters = np.concatenate([x, np.zeros(3), [height_factor]])
    return np.asarray(program.program.constraint(x, parameters), dtype=np.float64).ravel()


class Watch(cs.Callback):
    """What looks at every iterate: records its violation and cost, keeps the first feasible one, and stops there."""

    def __init__(self, size: int, rows: int, parameters: int) -> None:
        super().__init__()
        self._sizes = {"x": size, "f": 1, "g": rows, "lam_x": size, "lam_g": rows, "lam_p": parameters}
        self.history: list[tuple[float, float]] = []
        self._x: Array = np.zeros(size)
        self._found: Array | None = None
        self.construct("watch", {})

    def begin(self, program: GaitProgram, callback: Callback | None, stop: bool) -> None:
        """Forget the solve before."""
        self.history, self._found = [], None
        self._program, self._callback, self._stop = program, callback, stop

    def result(self) -> tuple[Array, int, bool]:
        """The first feasible iterate, or the last one where ``stop`` was not asked for; its iteration; success."""
        tolerance = self._program.settings.tolerance
        if self._stop and self._found is not None:
            return self._found, len(self.history) - 1, True
        return self._x, len(self.history) - 1, bool(self.history) and self.history[-1][0] < tolerance

    def get_n_in(self) -> int:
        """As many as IPOPT gives."""
        return int(cs.nlpsol_n_out())

    def get_n_out(self) -> int:
        """The answer alone."""
        return 1

    def get_name_in(self, i: int) -> str:
        """CasADi's names."""
        return str(cs.nlpsol_out(i))

    def get_name_out(self, i: int) -> str:
        """CasADi's name."""
        return "ret"

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        """All dense."""
        return cs.Sparsity.dense(self._sizes[cs.nlpsol_out(i)], 1)

    def eval(self, arguments: Sequence[cs.DM]) -> list[Any]:
        """IPOPT's call at each iterate: 1 stops it."""
        self._x = np.asarray(arguments[0], dtype=np.float64).ravel()
        violation = float(self._program.program.excess(np.asarray(arguments[2]).ravel()).max(initial=0.0))
        self.history.append((violation, float(arguments[1])))
        stop = bool(self._callback and self._callback(len(self.history) - 1, *self.history[-1]))
        if violation < self._program.settings.tolerance and self._found is None:
            self._found = self._x.copy()
        return [int(stop or (self._stop and self._found is not None))]


def _solver(program: GaitProgram, smooth: bool, limit: int, options: dict[str, Any]) -> tuple[Any, Watch]:
    """IPOPT on the program, and what watches it; built once for each kind of objective and options."""
    key = (smooth, limit, tuple(sorted(options.items())))
    if key not in program._solvers:
        nlp = program.program
        watch = Watch(nlp.size, nlp.rows, nlp.size + 4)
        exact = program.settings.hessian == "exact"
        own = {
            "ipopt.max_iter": limit, "ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False,
            "ipopt.hessian_approximation": "exact" if exact else "limited-memory",
            **IPOPT, **{f"ipopt.{name}": value for name, value in options.items()},
            "iteration_callback": watch, "jac_g": nlp.jacobian, "grad_f": nlp.gradient(smooth),
        }  # fmt: skip
        if exact:
            own["hess_lag"] = nlp.hessian(smooth)
        x, p = cs.MX.sym("x", nlp.size), cs.MX.sym("p", nlp.size + 4)
        oracle = {"x": x, "p": p, "f": nlp.objective(smooth)(x, p), "g": nlp.constraint(x, p)}
        program._solvers[key] = cs.nlpsol("gait", "ipopt", oracle, own), watch
    found: tuple[Any, Watch] = program._solvers[key]
    return found


IPOPT: dict[str, Any] = {
    "ipopt.linear_solver": "mumps",
    "ipopt.nlp_scaling_method": "none",
    "ipopt.mu_strategy": "adaptive",  # monotone barriers of the default take tens of iterations more, or fail
    "ipopt.tol": 1e-6,
}
