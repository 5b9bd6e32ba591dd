"""The options of the finite element room."""

from __future__ import annotations

from dataclasses import dataclass

from scan2fea.options import option


@dataclass(frozen=True, kw_only=True)
class FeaOptions:
    """What the part is made of, how it stands, and how hard the solver may work."""

    material: str = option("S235", "name of the material: see the table in the user guide (S235, S355, A36, A992, C30/37, 6061-T6, 304, ...)")
    youngs_pa: float | None = option(None, "Young's modulus instead of the material's", unit="Pa", minimum=1e6, maximum=1e13)
    poisson: float | None = option(None, "Poisson's ratio instead of the material's", minimum=0.0, maximum=0.49)
    density_kg_m3: float | None = option(None, "density instead of the material's", unit="kg/m3", minimum=1e-3, maximum=1e5)
    gravity_m_s2: float = option(9.80665, "acceleration of the self weight (standard gravity, ISO 80000-3)", unit="m/s2", minimum=1e-6, maximum=1e6)
    down: str = option("-z", "axis along which the self weight acts", choices=("-x", "+x", "-y", "+y", "-z", "+z"))
    supports: tuple[str, ...] = option((), 'faces held: "[object/]SET [directions of xyz]"; "none": the part floats; empty: its lowest faces')
    loads: tuple[str, ...] = option(
        (), 'load cases: "[case:] [object/]SET force|moment|gravity X Y Z" or "... pressure P", SI, e.g. "END_LAST force 0 0 -100"'
    )
    test_force_n: float = option(100.0, "force of the automatic cases of members (tension, bending, buckling)", unit="N", minimum=1e-6, maximum=1e9)
    buckling: bool = option(False, "find the buckling factor of every load case (of members: always, under axial force)")
    member_cases: bool = option(True, "solve the cases of members that have closed forms: tension, bending, torsion, buckling")
    n_samples: int = option(
        200, "samples of the dimensions for the standard deviations of a member's response; 0: first order alone", minimum=0, maximum=100_000
    )
    seed: int = option(0, "seed of these samples", minimum=0)
    n_modes: int = option(4, "elastic modes of the free body, beyond its six rigid-body modes", minimum=1, maximum=40)
    support_band: float = option(0.02, "part of the height above the lowest point that counts as lowest", minimum=1e-6, maximum=0.5)
    solver: str = option(
        "auto",
        "direct: Cholesky factors; amg: multigrid; auto: direct where its factors fit max_factor_mb; calculix: auto, and CalculiX beside it",
        choices=("auto", "direct", "amg", "calculix"),
    )
    max_dof: int = option(400_000, "degrees of freedom above which the solver refuses", minimum=12)
    max_factor_mb: float = option(1400.0, "largest memory of the direct solver", unit="MiB", minimum=1.0)
    max_residual: float = option(1e-6, "largest error of the static solution, in the energy norm", minimum=1e-12, maximum=1e-2)
