"""Makes the rows of the tests: Hostun sand by hypoplasticity. Run: python make_readings.py.

P.-A. von Wolffersdorff (1996), A hypoplastic relation for granular materials with a predefined
limit state surface, Mech. Cohesive-Frictional Mater. 1; constants of Hostun RF sand from I. Herle
and G. Gudehus (1999), Mech. Cohesive-Frictional Mater. 4. One rate equation without elasticity,
yield surface and plastic potential: no code of geoident's is used, and none of its laws.

What an engineer would draw from these curves without noise, each by its definition at 100 kPa, goes
to truth.yaml.
"""

import csv
from math import asin, degrees, exp, log, radians, sin, sqrt
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

FOLDER = Path(__file__).parent
PHI_C, H_S, N = radians(31.0), 1000e3, 0.29  # kPa
E_D0, E_C0, E_I0, ALPHA, BETA = 0.61, 0.96, 1.09, 0.13, 2.0
VOID_RATIO = 0.72  # of all specimens, medium dense
A = sqrt(3.0) * (3.0 - sin(PHI_C)) / (2.0 * sqrt(2.0) * sin(PHI_C))
STEP = 5e-5  # of axial strain
CELLS = (50.0, 200.0, 400.0)  # kPa
STRAINS = (0.005, 0.01, 0.02, 0.035, 0.05)
LAST = 0.09
Q_SD, VOLUME_SD, STRAIN_SD = 0.01, 3e-4, 2e-4  # 1 % of the strength; strains
LOADS = (25.0, 50.0, 100.0, 200.0, 50.0, 12.5)  # kPa
SEATING = 12.5  # kPa


def rate(stress, strain_rate, e):
    """Rate of the stress (axial, radial), kPa, compression positive, by a rate of strain."""
    T = -np.array([stress[0], stress[1], stress[1]])
    D = -np.array([strain_rate[0], strain_rate[1], strain_rate[1]])
    size = -T.sum()
    shape = T / T.sum()
    apart = shape - 1.0 / 3.0
    tan_psi = sqrt(3.0) * float(np.linalg.norm(apart))
    squares = float((apart**2).sum())
    cos_3 = -sqrt(6.0) * float((apart**3).sum()) / squares**1.5 if squares > 1e-20 else -1.0
    part = (2.0 - tan_psi**2) / (2.0 + sqrt(2.0) * tan_psi * cos_3)
    F = sqrt(tan_psi**2 / 8.0 + part) - tan_psi / (2.0 * sqrt(2.0))
    falls = exp(-((size / H_S) ** N))
    e_d, e_c, e_i = E_D0 * falls, E_C0 * falls, E_I0 * falls
    density = ((e - e_d) / (e_c - e_d)) ** ALPHA
    base = 3.0 + A**2 - sqrt(3.0) * A * ((E_I0 - E_D0) / (E_C0 - E_D0)) ** ALPHA
    stiff = H_S / N * (1.0 + e_i) / e_i * (e_i / e) ** BETA * (size / H_S) ** (1.0 - N) / base
    moved = F**2 * D + A**2 * shape * float(shape @ D)
    moved += density * A * F * (shape + apart) * float(np.linalg.norm(D))
    change = stiff / float(shape @ shape) * moved
    return -change[:2]


def triaxial(cell, last):
    """Axial strain, deviator stress (kPa) and volumetric strain (n,), compression positive."""
    stress, e, volume = np.array([cell, cell]), VOID_RATIO, 0.0
    rows = [(0.0, 0.0, 0.0)]
    for k in range(round(last / STEP)):
        across = brentq(lambda r, s=stress, e=e: rate(s, (1.0, r), e)[1], -3.0, 1.0)
        stress = np.array([stress[0] + STEP * rate(stress, (1.0, across), e)[0], cell])
        volume += STEP * (1.0 + 2.0 * across)
        e = (1.0 + VOID_RATIO) * exp(-volume) - 1.0
        rows.append(((k + 1) * STEP, stress[0] - cell, volume))
    return np.array(rows).T


def oedometer(loads):
    """Vertical stress (kPa) and strain (2, n) of each load."""
    stress, strain, rows = np.array([SEATING, SEATING]), 0.0, []
    for load in loads:
        sense = 1.0 if load > stress[0] else -1.0
        while sense * (load - stress[0]) > 1e-9:
            e = (1.0 + VOID_RATIO) * exp(-strain) - 1.0
            change = rate(stress, (sense, 0.0), e)
            step = min(STEP, sense * (load - stress[0]) / abs(change[0]))
            stress, strain = stress + step * change, strain + sense * step
        rows.append((load, strain))
    return np.array(rows).T


def write(name, header, rows):
    """A table of a laboratory."""
    with (FOLDER / name).open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])


def drawn(cell):
    """Secant modulus (kPa) at half of the strength, angles of friction and dilation at it, deg."""
    strain, q, volume = triaxial(cell, LAST)
    peak = int(np.argmax(q))
    half = 0.5 * q[peak]
    dilates = -float(np.gradient(volume, strain)[peak])
    friction = asin(q[peak] / (q[peak] + 2.0 * cell))
    secant = half / float(np.interp(half, q[:peak], strain[:peak]))
    return secant, degrees(friction), degrees(asin(dilates / (2.0 + dilates)))


def truth():
    """Lines of truth.yaml."""
    (soft, _, _), (E50, phi, psi), (stiff, _, _) = (drawn(cell) for cell in (50.0, 100.0, 200.0))
    (_, before), (_, after) = oedometer((95.0, 105.0)).T
    yield f"E50: {E50 / 1e3:.1f} MPa"
    yield f"Eoed: {10.0 / (after - before) / 1e3:.1f} MPa"
    yield f"m: {log(stiff / soft) / log(4.0):.2f}"
    yield f"phi: {phi:.1f} deg"
    yield f"psi: {psi:.1f} deg"


def main():
    """The rows with noise, and truth.yaml."""
    noise = np.random.default_rng(35)
    for cell in CELLS:
        strain, q, volume = triaxial(cell, LAST)
        peak = int(np.argmax(q))
        at = [x for x in STRAINS if x <= strain[peak]]
        errors = noise.standard_normal((len(at), 2)) * (Q_SD * q[peak], VOLUME_SD)
        read = np.column_stack([np.interp(at, strain, q), np.interp(at, strain, volume)]) + errors
        rows = [
            (f"{100 * x:g}", f"{a:.1f}", f"{100 * b:.3f}")
            for x, (a, b) in zip(at, read, strict=True)
        ]
        header = ("axial_strain [%]", "deviator_stress [kPa]", "volumetric_strain [%]")
        write(f"tx-{cell:.0f}.csv", header, rows)
    loads, strains = oedometer(LOADS)
    strains += STRAIN_SD * noise.standard_normal(len(LOADS))
    rows = [(f"{load:g}", f"{100 * x:.3f}") for load, x in zip(loads, strains, strict=True)]
    write("oedometer.csv", ("vertical_stress [kPa]", "axial_strain [%]"), rows)
    (FOLDER / "truth.yaml").write_text("\n".join(truth()) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
