"""How the shifts of spots become angles of a camera: the solver, and the geometry behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from losbench.arrays import Floats
from losbench.checks import boolean, choice
from losbench.estimation.solvers import IRLS, SOLVERS, LeastSquares, Solver, read_solver
from losbench.optics.camera import Camera, Model
from losbench.pointing.attitude import AttitudeFit, solve_attitude

__all__ = ["Angles", "as_angles"]


_TELLS_OUTLIERS = 4  # spots; below, no outlier can be told from the rest


@dataclass(frozen=True)
class Angles:
    """How `measure` turns shifts into angles: the solver, and what `solve_attitude` makes it solve.

    Parameters
    ----------
    solver : IRLS(...), LeastSquares(), LTS(...), MM(...), their name, any with a ``fit``, or "auto"
        "auto", as None, is `IRLS` with one weight per spot for four or more spots, and least
        squares below, where no outlier can be told from the rest.
    model : "pinhole" or "paper"
        Rows of the design matrix, see `design_matrix`.
    group : "spot" or None
        One weight for x and y of a spot, or one each.
    exact : bool
        Iterate on the exact projection, pinhole only.

    Raises
    ------
    ValueError
        If there is no such solver or model.

    Examples
    --------
    >>> Angles(model="paper").sentence(4)
    'Angles by IRLS, Huber 1.345, one weight per spot, 4 spots, redundancy 5.'
    """

    solver: Solver | str | None = None
    model: Model = "pinhole"
    group: Literal["spot"] | None = "spot"
    exact: bool = False

    def __post_init__(self) -> None:
        read_solver(self.solver, None, named={"auto": IRLS(), **SOLVERS}, default="auto")
        choice("model", self.model, ("pinhole", "paper"))
        boolean("exact", self.exact)

    def chosen(self, n_spots: int) -> Solver:
        """Return the solver for so many spots."""
        auto = IRLS() if n_spots >= _TELLS_OUTLIERS else LeastSquares()
        if self.solver is None:
            return auto
        return read_solver(self.solver, None, named={"auto": auto, **SOLVERS}, default="auto")

    def solve(
        self,
        camera: Camera | None,
        reference_px: Floats,
        shifts_px: Floats,
        sigma_px: Floats,
    ) -> tuple[AttitudeFit | None, str]:
        """Solve shifts (F, n, 2) of spots (n, 2), weighed by their errors, in pixels, and say how;
        without a camera there are no angles.
        """
        if camera is None:
            return None, "No camera was given: the table holds shifts in pixels, no angles."
        solver, said = self.chosen(len(reference_px)), self.sentence(len(reference_px))
        fit = solve_attitude(
            camera.points_mm(reference_px),
            shifts_px * camera.pixel_mm,
            solver=solver,
            model=self.model,
            sigma=sigma_px * camera.pixel_mm,
            group=self.group,
            exact=self.exact,
        )
        return fit, said

    def sentence(self, n_spots: int) -> str:
        """Say which solver it is, and what it can tell."""
        solver = self.chosen(n_spots)
        weights = "one weight per spot" if self.group else "one weight per coordinate"
        if solver == LeastSquares():
            how = "least squares"
        elif solver == IRLS():
            how = f"IRLS, Huber 1.345, {weights}"
        else:
            how = f"{solver!r}, {weights}"
        blind = " Two spots cannot tell which of them is bad." if n_spots == 2 else ""
        return f"Angles by {how}, {n_spots} spots, redundancy {2 * n_spots - 3}.{blind}"


def as_angles(solver: Angles | Solver | str | None) -> Angles:
    """Return how a solver, or its name, makes angles of shifts."""
    return solver if isinstance(solver, Angles) else Angles(solver)
