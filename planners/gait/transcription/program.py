"""The nonlinear program: values, exact sparse Jacobians and Hessians out of blocks, as CasADi
functions for IPOPT.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs
import numpy as np
from scipy.sparse import csr_array, vstack

from ...arguments import cached_property
from ...files.arrays import Array
from .blocks import Block, Compiled, Constraint, TaylorBank, blocks_of, matrix, scattered


class Program:
    """lower ≤ g(x) ≤ upper, and an objective, from constraints and cost blocks.

    Parameters of all functions, p: the reference x₁ (size), the weights of the objective's parts
    (3) and the factor on the heights of the terrain. Objective: ½ w₀ ‖x − x₁‖² + ½ w₁ Σ costs + ½
    w₂ ‖rates x‖².
    """

    def __init__(
        self, size: int, constraints: Sequence[Constraint], costs: Sequence[Block], rates: csr_array
    ) -> None:
        self.size, self.constraints = size, tuple(constraints)
        self.lower = np.concatenate([one.lower for one in constraints])
        self.upper = np.concatenate([one.upper for one in constraints])
        self._blocks = [Compiled(block) for block in blocks_of(constraints)]
        self._costs_of, self._rates = tuple(costs), rates
        linear = [
            one.linear if one.linear is not None else csr_array((one.rows, size))
            for one in constraints
        ]
        self._linear = matrix(vstack(linear))
        self._x, self._p = cs.MX.sym("x", size), cs.MX.sym("p", size + 4)
        self._reference, self._weights, self._factor = cs.vertsplit(
            self._p, [0, size, size + 3, size + 4]
        )
        self._bank = TaylorBank(self._x, self._factor)
        self._scatters = [
            matrix(scattered(compiled.block.scatter, self.rows)) for compiled in self._blocks
        ]
        self._multipliers = cs.MX.sym("lam_g", self.rows)

    @cached_property
    def _costs(self) -> list[Compiled]:
        return [Compiled(block) for block in self._costs_of]

    @property
    def rows(self) -> int:
        """Number of constraints."""
        return len(self.lower)

    @property
    def errors(self) -> list[BaseException]:
        """Errors that were raised where the functions were evaluated; CasADi does not pass them on."""
        return self._bank.errors

    # ------------------------------------------------------------------------------------------ the
    # constraints

    @cached_property
    def constraint(self) -> cs.Function:
        """(x, p) → g."""
        return cs.Function("nlp_g", [self._x, self._p], [self._constraint], ["x", "p"], ["g"])

    @cached_property
    def _constraint(self) -> cs.MX:
        total = self._linear @ self._x
        for compiled, scatter in zip(self._blocks, self._scatters, strict=True):
            value = compiled.value.map(compiled.block.count)(*compiled.at(self._x, self._bank, 0))
            total += scatter @ cs.densify(cs.vec(value))
        return total

    @cached_property
    def jacobian(self) -> cs.Function:
        """(x, p) → nothing, ∂g/∂x, sparse; IPOPT asks for g apart."""
        total = cs.MX(self._linear)
        for compiled, scatter in zip(self._blocks, self._scatters, strict=True):
            total += scatter @ self._slopes(compiled)
        nothing = cs.MX(self.rows, 1)
        return cs.Function(
            "nlp_jac_g", [self._x, self._p], [nothing, total], ["x", "p"], ["g", "jac_g_x"]
        )

    def _slopes(self, compiled: Compiled) -> cs.MX:
        """Derivatives of all outputs of a block in x, shape (K · outputs, size)."""
        slopes = compiled.jacobian.map(compiled.block.count)(*compiled.at(self._x, self._bank, 1))
        return _diagonal(compiled.jacobian, slopes, compiled.block.count) @ compiled.gather

    def _curvature(self, compiled: Compiled, multipliers: cs.MX) -> cs.MX:
        """Hessian of multipliers · outputs, multipliers of shape (outputs, K)."""
        arguments = compiled.at(self._x, self._bank, 2)
        curvature = compiled.hessian.map(compiled.block.count)(*arguments, multipliers)
        diagonal = _diagonal(compiled.hessian, curvature, compiled.block.count)
        return compiled.gather.T @ (diagonal @ compiled.gather)

    # --------------------------------------------------------------------------------------------
    # the objective

    def objective(self, costs: bool) -> cs.Function:
        """(x, p) → f; ``costs``: with all parts, else the first alone."""
        return cs.Function("nlp_f", [self._x, self._p], [self._objective(costs)], ["x", "p"], ["f"])

    def _objective(self, costs: bool) -> cs.MX:
        total = 0.5 * self._weights[0] * cs.sumsqr(self._x - self._reference)
        if costs:
            for compiled in self._costs:
                value = compiled.value.map(compiled.block.count)(
                    *compiled.at(self._x, self._bank, 0)
                )
                total += 0.5 * self._weights[1] * cs.sum2(value)
            total += 0.5 * self._weights[2] * cs.sumsqr(matrix(self._rates) @ self._x)
        return total

    def gradient(self, costs: bool) -> cs.Function:
        """(x, p) → f, ∇f; dense, for an interior-point code reads every entry."""
        total = self._weights[0] * (self._x - self._reference)
        if costs:
            for compiled in self._costs:
                slopes = self._slopes(compiled)
                total += (
                    0.5 * self._weights[1] * cs.densify(slopes.T @ cs.MX.ones(compiled.block.count))
                )
            rates = matrix(self._rates)
            total += self._weights[2] * (rates.T @ (rates @ self._x))
        total = cs.densify(total)
        if total.nnz() != self.size:
            raise AssertionError("the gradient has to be dense")
        return cs.Function(
            "nlp_grad_f",
            [self._x, self._p],
            [self._objective(costs), total],
            ["x", "p"],
            ["f", "grad_f_x"],
        )

    def hessian(self, costs: bool) -> cs.Function:
        """(x, p, λ_f, λ_g) → upper triangle of the Lagrangian's Hessian, sparse."""
        sigma = cs.MX.sym("lam_f")
        total = sigma * self._weights[0] * cs.MX(cs.DM.eye(self.size))
        for part in self._curvatures:
            total += part
        if costs:
            for compiled in self._costs:
                total += self._curvature(
                    compiled, 0.5 * sigma * self._weights[1] * cs.MX.ones(1, compiled.block.count)
                )
            rates = matrix(self._rates)
            total += sigma * self._weights[2] * (rates.T @ rates)
        return cs.Function(
            "nlp_hess_l",
            [self._x, self._p, sigma, self._multipliers],
            [cs.triu(total)],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        )

    @cached_property
    def _curvatures(self) -> list[cs.MX]:
        """Hessian of multipliers · g, block by block."""
        parts = []
        for compiled, scatter in zip(self._blocks, self._scatters, strict=True):
            outputs, count = compiled.block.scatter.shape[1], compiled.block.count
            local = scatter.T @ self._multipliers
            parts.append(self._curvature(compiled, cs.reshape(local, outputs, count)))
        return parts

    # ------------------------------------------------------------------------------------------------
    # violations

    def excess(self, values: Array) -> Array:
        """Distance of g outside its bounds, shape (rows,), at least 0."""
        return np.asarray(np.maximum(np.maximum(self.lower - values, values - self.upper), 0.0))

    def violations(self, values: Array) -> dict[str, float]:
        """The largest violation of each named group of constraints."""
        excess, first = self.excess(values), 0
        largest: dict[str, float] = {}
        for one in self.constraints:
            worst = float(excess[first : first + one.rows].max(initial=0.0))
            largest[one.name] = max(largest.get(one.name, 0.0), worst)
            first += one.rows
        return largest


def _diagonal(kernel: cs.Function, found: cs.MX, count: int) -> cs.MX:
    """The block-diagonal matrix of a map's outputs, which stand side by side."""
    pattern = kernel.sparsity_out(0)
    return cs.MX(cs.diagcat(*[pattern] * count), cs.reshape(found.nz[:], found.nnz(), 1))
