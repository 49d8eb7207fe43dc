"""Makes km-*.csv: what a squeezing tunnel shows, by a calculation that shares no code with ours.

Each section is integrated from the edge of its plastic zone to its wall (Runge-Kutta), with the
generalised criterion of Hoek and Brown (2002), plastic flow without change of volume, elastic
strains, and sigma_z where it becomes the largest stress. Its reaction curve is then read at the
distances of the readings by the profile of Vlachopoulos and Diederichs (2009). The noise is that of
the accuracies in section.yaml. ``radial`` is held against the closed form by a test.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

HERE = Path(__file__).resolve().parent
RADIUS, NU, SIGCI, MI, EI = 3.0, 0.25, 40.0, 10.0, 24_000.0  # m, -, MPa, -, MPa
SHIFT, SCATTER = -3.0, 1.5  # of the GSI of the rock against the mapped one
SECTIONS = {  # mapped GSI, vertical stress in MPa
    "km-1": (38, 9.5),
    "km-2": (31, 8.4),
    "km-3": (45, 11.6),
    "km-4": (34, 10.2),
    "km-5": (41, 9.0),
    "km-6": (28, 7.6),
    "km-7": (48, 12.4),
    "km-8": (36, 8.8),
    "km-9": (33, 9.2),
    "km-10": (43, 11.0),
}
STAGES = {"first reading": 2.0, "day 2": 5.0, "day 4": 11.0, "day 8": 23.0, "day 30": 90.0}  # m
ANCHORS = {"EX.a2": 5.0, "EX.a5": 8.0}  # radii of the anchors of the extensometer, m
NOISE = {"CV0": 0.5, "CV60": 0.5, "EX.a2": 0.3, "EX.a5": 0.3}  # mm


@dataclass(frozen=True)
class Rock:
    """sigma_1 = sigma_3 + sigci (m sigma_3 / sigci + s)^a, compression positive; MPa."""

    E: float
    nu: float
    sigci: float
    m: float
    s: float
    a: float

    def hoop(self, radial):
        """Largest stress at the limit."""
        return radial + self.sigci * (self.m * radial / self.sigci + self.s) ** self.a


def rock_of(gsi):
    """Hoek, Carranza-Torres & Corkum 2002 and Hoek & Diederichs 2006, undisturbed."""
    return Rock(
        E=EI * (0.02 + 1.0 / (1.0 + np.exp((60.0 - gsi) / 11.0))),
        nu=NU,
        sigci=SIGCI,
        m=MI * np.exp((gsi - 100.0) / 28.0),
        s=np.exp((gsi - 100.0) / 9.0),
        a=0.5 + (np.exp(-gsi / 15.0) - np.exp(-20.0 / 3.0)) / 6.0,
    )


def critical(rock, far):
    """The pressure below which the wall yields: 2 p0 - p = hoop(p)."""
    if 2.0 * far <= rock.hoop(0.0):
        return 0.0
    return brentq(lambda p: rock.hoop(p) + p - 2.0 * far, 0.0, far)


def radial(rock, far, inside, radii, dilation=1.0):
    """Motion inwards at some radii (m), and the plastic radius, under a pressure inside.

    Args:
        rock: the ground.
        far: stress all round, MPa.
        inside: pressure at the wall, MPa.
        radii: of the tunnel, m, first; then of the points.
        dilation: K of eps_r^p = -K (eps_t^p + eps_z^p).
    """
    edge, shear = critical(rock, far), rock.E / (2.0 * (1.0 + rock.nu))
    wall, radii = radii[0], np.asarray(radii)
    if inside >= edge:
        return (far - inside) * wall**2 / (2.0 * shear * radii), wall

    def strains(sr):
        """Elastic strains, compression positive, of what the stresses have changed."""
        st = rock.hoop(sr)
        sz = min(far + rock.nu * (sr + st - 2.0 * far), st)
        d = np.array([sr, st, sz]) - far
        return ((1.0 + rock.nu) * d - rock.nu * d.sum()) / rock.E

    # ln of the radius by sigma_r gives the plastic radius; then u and sigma_r go inwards together
    way = solve_ivp(
        lambda sr, _: [1.0 / (rock.hoop(sr) - sr)], (inside, edge), [0.0], rtol=1e-11, atol=1e-13
    )
    reach = wall * np.exp(way.y[0, -1])

    def inwards(r, y):
        sr, u = y
        er, et, ez = strains(sr)
        return [(rock.hoop(sr) - sr) / r, er + dilation * (et + ez) - dilation * u / r]

    start = [edge, (far - edge) * reach / (2.0 * shear)]
    found = solve_ivp(
        inwards, (reach, wall), start, rtol=1e-10, atol=1e-13, dense_output=True, method="DOP853"
    )
    outside = start[1] * reach / radii
    return np.where(radii < reach, found.sol(np.minimum(radii, reach))[1], outside), reach


def motions(rock, far, radii):
    """Motion inwards (stages, radii), m, at the distances of the stages."""
    last, reach = radial(rock, far, 0.0, radii)
    at_face = np.exp(-0.15 * reach / radii[0]) / 3.0
    found = []
    for distance in STAGES.values():
        share = 1.0 - (1.0 - at_face) * np.exp(-1.5 * distance / reach)

        def off(pressure, share=share):
            return radial(rock, far, pressure, radii[:1])[0][0] - share * last[0]

        found.append(radial(rock, far, brentq(off, 0.0, far, xtol=1e-12), radii)[0])
    return np.array(found)


def main():
    """Write the files."""
    rng = np.random.default_rng(11)
    for name, (mapped, far) in SECTIONS.items():
        gsi = mapped + SHIFT + SCATTER * rng.normal()
        moved = 1e3 * motions(rock_of(gsi), far, [RADIUS, *ANCHORS.values()])
        wall = moved[:, 0]
        read = {"CV0": -2.0 * wall, "CV60": -2.0 * wall}
        read |= {key: wall - moved[:, 1 + n] for n, key in enumerate(ANCHORS)}
        print(f"{name}: GSI {gsi:.2f}, wall {wall.round(1)} mm")
        with (HERE / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["gauge", "stage", "value", "unit"])
            for gauge, values in read.items():
                noise = NOISE[gauge] * rng.normal(size=len(values))
                for stage, value, own in zip(STAGES, values - values[0], noise, strict=True):
                    if stage != "first reading":
                        writer.writerow([gauge, stage, f"{value + own:.1f}", "mm"])


if __name__ == "__main__":
    main()
