"""How near the section fit comes to the Cramer-Rao bound, and how often it names the right family. Printed, not asserted.

    python benchmarks/estimation_sections.py [--quick] [--seeds N] [--only WORD]

limit: RMSE over the bound, bias and coverage of the 95 % intervals per dimension, for clean Gaussian noise. exact: largest error without noise.
laws: bias under noise of another law (uniform and Laplace in the scanner's own axes), and how often t is withheld. family: every family, sizes and
noises drawn from the seed, faces hidden and stray points added. time: processor seconds on one thread.
Points are uniform in area over the whole member, end caps included; roll, place and the axes of the noise are random.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from scan2fea.estimation.fit import FitOptions, SectionFit, fit_section
from scan2fea.kernel.section_likelihood import face_lengths, faces, information
from scan2fea.kernel.sections import PARAMETERS, ROUND, section, section_area

THIN = ("L", (0.127, 0.127, 0.00635), 3.048)
BLOCK = ("L", (0.254, 0.254, 0.127), 2.54)
TYPICAL = {
    "L": (0.16, 0.1, 0.012),
    "I": (0.22, 0.11, 0.006, 0.0092),
    "C": (0.14, 0.06, 0.007, 0.01),
    "T": (0.1, 0.09, 0.008, 0.01),
    "RHS": (0.14, 0.08, 0.006),
    "CHS": (0.1143, 0.006),
    "rect": (0.1, 0.02),
    "round": (0.05,),
}


def rotation(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def member(
    family: str,
    values: tuple[float, ...],
    length: float,
    n: int,
    sigma: float,
    rng: np.random.Generator,
    *,
    law: str = "gaussian",
    weight: np.ndarray | None = None,
    clutter: float = 0.0,
    caps: bool = True,
) -> np.ndarray:
    """(n, 3) points in a provisional member frame."""
    shape = section(family, dict(zip(PARAMETERS[family], values, strict=True)), 2880)
    start = np.concatenate(shape.loops)
    step = np.concatenate([np.roll(loop, -1, axis=0) for loop in shape.loops]) - start
    size = np.hypot(*step.T)
    names = [name for loop in shape.face_names for name in loop]
    density = np.ones(len(names)) if weight is None else np.array([weight[faces(family).index(name)] for name in names])
    share = size * density
    side_area, cap_area = share.sum() * length, section_area(shape) if caps else 0.0
    on_cap = rng.random(n) < 2 * cap_area / (side_area + 2 * cap_area)
    edge = rng.choice(len(size), n, p=share / share.sum())
    xy = start[edge] + step[edge] * rng.random((n, 1))
    z = rng.uniform(0, length, n)
    xy[on_cap] = inside(shape, int(on_cap.sum()), rng)
    z[on_cap] = np.where(rng.random(int(on_cap.sum())) < 0.5, 0.0, length)
    if family in ROUND:  # from the chord to the circle
        outer = np.hypot(*xy.T)
        for radius in [values[0] / 2, values[0] / 2 - values[1]] if family == "CHS" else [values[0] / 2]:
            near = (np.abs(outer - radius) < 1e-6 * radius) & ~on_cap
            xy[near] *= (radius / outer[near])[:, None]
    turn = rng.uniform(0, 2 * np.pi)
    c, s = np.cos(turn), np.sin(turn)
    points = np.column_stack([xy @ np.array([[c, s], [-s, c]]) + rng.uniform(-0.05, 0.05, 2), z])
    noise = {
        "gaussian": lambda: rng.normal(0, sigma, (n, 3)),
        "uniform": lambda: rng.uniform(-sigma * 3**0.5, sigma * 3**0.5, (n, 3)) @ rotation(rng).T,
        "laplace": lambda: rng.laplace(0, sigma / 2**0.5, (n, 3)) @ rotation(rng).T,
    }[law]()
    points = points + noise
    stray = int(clutter * n)
    if stray:
        low, high = points[:, :2].min(0), points[:, :2].max(0)
        points[:stray, :2] = rng.uniform(low - 0.3 * (high - low), high + 0.3 * (high - low), (stray, 2))
    return points


def inside(shape, n: int, rng: np.random.Generator) -> np.ndarray:
    """(n, 2) uniform in the section."""
    low, high = shape.loops[0].min(0), shape.loops[0].max(0)
    out = np.empty((0, 2))
    while len(out) < n:
        p = rng.uniform(low, high, (4 * n + 100, 2))
        odd = np.zeros(len(p), bool)
        for loop in shape.loops:
            a, b = loop, np.roll(loop, -1, axis=0)
            for (ax, ay), (bx, by) in zip(a, b, strict=True):
                if ay != by:
                    hit = ((ay > p[:, 1]) != (by > p[:, 1])) & (p[:, 0] < ax + (p[:, 1] - ay) * (bx - ax) / (by - ay))
                    odd ^= hit
        out = np.concatenate([out, p[odd]])
    return out[:n]


def bound(family: str, values: tuple[float, ...], sigma: float, n: int) -> np.ndarray:
    sd = information(family, np.array(values), sigma).sd(n)
    return np.array([sd[name] for name in PARAMETERS[family]])


def limit(seeds: int, quick: bool) -> None:
    print("\nlimit: Gaussian noise, all faces seen. ratio = RMSE / bound; cover = 95 % intervals that hold; seen = observable")
    cells = [(*THIN, s, n) for n in ((3000, 20_000) if quick else (3000, 20_000, 200_000)) for s in (0.0005, 0.002, 0.0067, 0.02)]
    cells += [(*BLOCK, s, 3000) for s in (0.002, 0.0067, 0.02)]
    cells += [(f, v, 2.0, s, 5000) for f, v in TYPICAL.items() for s in (0.0005, 0.002)]
    for family, values, length, sigma, n in cells:
        report(family, values, length, sigma, n, seeds)


def report(family: str, values: tuple[float, ...], length: float, sigma: float, n: int, seeds: int, law: str = "gaussian", families=()) -> None:
    errors, covers, seen, wrong, seconds = [], [], [], 0, 0.0
    crb = bound(family, values, sigma, n)
    options = FitOptions(families=families) if families else FitOptions()
    for seed in range(seeds):
        points = member(family, values, length, n, sigma, np.random.default_rng(1000 + seed), law=law)
        begun = time.process_time()
        fit = fit_section(points, options)
        seconds += time.process_time() - begun
        if fit.family != family:
            wrong += 1
            continue
        error = fit.values - np.array(values)
        errors.append(error)
        covers.append(np.abs(error) < 1.96 * fit.std)
        seen.append([fit.observable[name] for name in fit.names])
    head = f"{family:5s} {n:7d} {sigma * 1e3:5.1f} mm {law:8s} wrong {wrong:2d}/{seeds} {seconds / seeds:5.2f} s"
    if not errors:
        print(head)
        return
    e = np.array(errors)
    ratio, bias = np.sqrt((e**2).mean(0)) / crb, e.mean(0) * 1e3
    cells = [
        f"{name} ratio {r:5.2f} bias {b:+7.3f} mm cover {c:4.2f} seen {o:4.2f} (bound {k * 1e3:.3g})"
        for name, r, b, c, o, k in zip(PARAMETERS[family], ratio, bias, np.mean(covers, 0), np.mean(seen, 0), crb, strict=True)
    ]
    print(head + " | " + " | ".join(cells), flush=True)


def exact(seeds: int) -> None:
    print("\nexact: no noise, 5000 points; largest error over the seeds, mm")
    for family, values in {**TYPICAL, "thin L": THIN[1]}.items():
        worst, wrong = 0.0, 0
        name = "L" if family == "thin L" else family
        for seed in range(seeds):
            fit = fit_section(member(name, values, 2.0, 5000, 0.0, np.random.default_rng(seed)))
            if fit.family == name:
                worst = max(worst, float(np.abs(fit.values - np.array(values)).max()) * 1e3)
            wrong += fit.family != name
        print(f"{family:7s} {worst:.2e} mm, wrong family {wrong}/{seeds}", flush=True)


def laws(seeds: int) -> None:
    print("\nlaws: thin L, 20,000 points; leg errors beyond 1.5 mm, t withheld or within its standard deviations")
    for law, sigma in (("uniform", 0.02 / 3**0.5), ("uniform", 0.02), ("laplace", 0.0067), ("gaussian", 0.0067)):
        legs, honest, chosen = [], 0, {}
        for seed in range(seeds):
            fit = fit_section(member(*THIN, 20_000, sigma, np.random.default_rng(seed), law=law))
            chosen[fit.noise] = chosen.get(fit.noise, 0) + 1
            if fit.family == "L":
                error = fit.values - np.array(THIN[1])
                legs.append(error[:2])
                honest += (not fit.observable["t"]) or abs(error[2]) < 3 * fit.std[2]
        e = np.array(legs) * 1e3
        within = (np.abs(e).max(1) < 1.5).mean()
        head = f"{law:8s} {sigma * 1e3:5.2f} mm: right {len(legs)}/{seeds}, bias {e.mean(0).round(2)} mm"
        print(
            f"{head}, within 1.5 mm {within:.2f}, t honest {honest}, {chosen}",
            flush=True,
        )


def random_case(rng: np.random.Generator, family: str) -> tuple[tuple[float, ...], float, float]:
    """Dimensions, noise and length of a plausible section of a family."""
    big = float(np.exp(rng.uniform(np.log(0.05), np.log(0.4))))
    small = big * rng.uniform(0.4, 0.9)
    t = small * rng.uniform(0.06, 0.15)
    values = {
        "L": (big, small, t),
        "I": (big, small, t, t * rng.uniform(1, 1.6)),
        "C": (big, big * rng.uniform(0.3, 0.6), t * 0.7, t),
        "T": (small, big, t, t * rng.uniform(1, 1.4)),
        "RHS": (big, small, t),
        "CHS": (big, t),
        "rect": (big, big * rng.uniform(0.05, 0.5)),
        "round": (big,),
    }[family]
    sigma = (values[-1] if family != "round" else big) * float(rng.choice([0.03, 0.15, 0.4]))
    return values, min(sigma, 0.05 * big), big * rng.uniform(6, 20)


def family_rates(seeds: int) -> None:
    print(
        "\nfamily: drawn sizes, 5000 points. whole | up to 60 % of the outline hidden | 15 % stray points | both; right (and in the posterior)"
    )
    for family in PARAMETERS:
        cells = []
        for hide, clutter in ((0.0, 0.0), (0.6, 0.0), (0.0, 0.15), (0.6, 0.15)):
            right, honest, misses = 0, 0, []
            for seed in range(seeds):
                rng = np.random.default_rng(7000 + seed)
                values, sigma, length = random_case(rng, family)
                weight = hidden(family, values, hide, rng)
                fit = fit_section(member(family, values, length, 5000, sigma, rng, weight=weight, clutter=clutter))
                right += fit.family == family
                honest += fit.families.get(family, 0.0) > 0.05
                if fit.family != family:
                    misses.append(f"{seed}:{fit.family}")
            cells.append(f"{right}/{seeds} ({honest}) {' '.join(misses)}")
        print(f"{family:5s} " + " | ".join(cells), flush=True)


def hidden(family: str, values: tuple[float, ...], most: float, rng: np.random.Generator) -> np.ndarray | None:
    """Weights of a run of neighbouring faces hidden, at most that share of the outline; None where nothing is."""
    if most == 0:
        return None
    lengths = face_lengths(family, np.array(values))
    weight = np.ones(len(lengths))
    share = lengths / lengths.sum()
    goal, at = rng.uniform(0.2, most), int(rng.integers(len(lengths)))
    while share[weight == 0].sum() + share[at] <= goal:
        weight[at] = 0
        at = (at + 1) % len(lengths)
    return weight


def timing() -> None:
    print("\ntime: processor seconds, one thread, thin L at 2 mm")
    fit_section(member(*THIN, 1000, 0.002, np.random.default_rng(0)))
    for n in (3000, 20_000, 200_000, 2_000_000):
        points = member(*THIN, n, 0.002, np.random.default_rng(0))
        begun = time.process_time()
        fit: SectionFit = fit_section(points)
        print(f"{n:8d} points {time.process_time() - begun:6.2f} s  {fit.family} {fit.values * 1e3}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few seeds, no large clouds")
    parser.add_argument("--seeds", type=int, default=None)
    parser.add_argument("--only", choices=("limit", "exact", "laws", "family", "time"), default=None)
    args = parser.parse_args()
    seeds = args.seeds or (6 if args.quick else 50)
    parts = {
        "exact": lambda: exact(seeds),
        "limit": lambda: limit(seeds, args.quick),
        "laws": lambda: laws(seeds),
        "family": lambda: family_rates(seeds),
        "time": timing,
    }
    for name, part in parts.items():
        if args.only in (None, name):
            part()


if __name__ == "__main__":
    main()
