"""Is the final geometry the one that was scanned? Measured after the last step that moves anything."""

from __future__ import annotations

from dataclasses import replace

from scan2fea.kernel.coverage import Deviation
from scan2fea.types import Check
from scan2fea.units import MILLIMETRES_PER_METRE
from scan2fea.verification.limits import at_least, at_most
from scan2fea.verification.mesh import relative

NOISE_SIGMAS = 3.0  # 99.7 % of the points of a Gaussian scanner lie within


def deviation_checks(found: Deviation, spacing_m: float, sigma_m: float) -> tuple[Check, ...]:
    """Points to surface within the noise or the spacing, whichever is larger. Strays have been judged where they were told (`estimation.explain`)."""
    return (at_most("shape.deviation_p95", found.own_p95_m, max(NOISE_SIGMAS * sigma_m, spacing_m)),)


def free_form_checks(found: Deviation, supported_share: float) -> tuple[Check, ...]:
    """Hardly a point off the surface, such as those of a hole that was lost; and enough of the surface seen. Members are held to their own model.

    supported_share : share of the area that lies on a support plane, which closes it without being seen; it counts as known.
    """
    seen = min(1.0, found.measured_area_fraction + supported_share)
    return at_most("shape.stray_points", found.stray_share), at_least("shape.measured_area", seen)


def stations_checks(open_share: float, apart_m: float) -> tuple[Check, ...]:
    """What the places of the stations leave open of the volume (one standard deviation); none where they agree.

    apart_m : standard deviation of the difference of two of their places.
    """
    if not apart_m > 0:
        return ()
    check = at_most("shape.stations_apart", open_share)
    return (replace(check, says=f"{check.says} ({MILLIMETRES_PER_METRE * apart_m:.2g} mm, one standard deviation)"),)


def drift_checks(volume_m3: float, first_volume_m3: float, thicker: float, handles: int) -> tuple[Check, ...]:
    """What repair, remeshing and meshing did to the volume and the walls since the reconstruction.

    thicker : median over places of the relative change of the wall's thickness there.   handles : holes that go through, now against then.
    """
    return (
        at_most("shape.holes_changed", abs(handles)),
        at_most("shape.volume_drift", relative(volume_m3, first_volume_m3)),
        at_most("shape.thickness_drift", abs(thicker)),
    )
