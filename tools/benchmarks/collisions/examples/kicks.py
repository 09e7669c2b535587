#!/usr/bin/env python3
"""A solver for the benchmark, NumPy only: exact free flight, kicked by penalty springs (Störmer–Verlet, split so).

    cd tools/benchmarks/collisions
    python examples/kicks.py scenes/tanpura.json tanpura.npz --factor 4
    ../../collisions score tanpura.npz

It reads a scene's numbers, steps its modes at `factor` times the scene's rate, and writes displacement at the output point.
A rigid point is a spring as stiff as the step allows; the elastic board is what the scene says. Restitution 0 it knows not.
"""

import argparse
import json
import time

import numpy as np


def solve(scene, factor, modes=None):
    """Displacement (samples,) at the scene's instants and the CPU seconds that the steps took."""
    dt = 1.0 / (scene["rate_hz"] * factor)
    f, sigma, q = (np.array(scene[key])[:modes] for key in ("frequencies_hz", "decay_rates_1_s", "q0_m_sqrt_m"))
    keep = np.flatnonzero(f < 0.5 / dt) if modes is None else np.arange(f.size)
    omega, sigma, q = 2 * np.pi * f[keep], sigma[keep], q[keep]
    wall = scene.get("wall")
    x, height = (
        np.array((wall or scene["contacts"])[("grid_" if wall else "") + key]) for key in ("positions_m", "heights_m")
    )

    def phi(x):
        return np.sqrt(2 / scene["length_m"]) * np.sin(np.outer(x, (keep + 1) * np.pi / scene["length_m"]))

    shapes, out, mu = phi(x), phi([scene["output_m"]])[0], scene["linear_density_kg_m"]
    spring = 1.0 / (np.linalg.norm(shapes @ shapes.T, 2) / mu * dt**2) if x.size else 0.0
    if wall and wall["stiffness_n_m2"]:
        spring = wall["stiffness_n_m2"] * (x[1] - x[0])
    root = np.sqrt(np.array(omega**2 - sigma**2, dtype=complex))  # imaginary where a mode is overdamped
    decay, sine = np.exp(-sigma * dt), np.sin(root * dt) / root
    c, s = (decay * np.cos(root * dt)).real, (decay * sine).real  # q' = (c + σs) q + s v, v' = (c − σs) v − ω²s q
    qq, vq, vv = c + sigma * s, -(omega**2) * s, c - sigma * s
    ramps, v, u = scene.get("obstacle_ramps", []), np.zeros_like(q), np.empty(scene["samples"])
    pull = dt * spring / mu * shapes.T
    started = time.process_time()
    for step in range((u.size - 1) * factor + 1):
        if step % factor == 0:
            u[step // factor] = out @ q
        top = height
        for ramp in ramps:
            part = min(1.0, max(0.0, (step * dt - ramp["start_s"]) / ramp["duration_s"]))
            top = top + ramp["displacement_m"] * 0.5 * (1 - np.cos(np.pi * part))
        depth = top - shapes @ q
        if depth.max(initial=0.0) > 0.0:  # half a kick before, half behind the flight: two halves meet here
            v = v + pull @ np.maximum(depth, 0.0) * (0.5 if step == 0 else 1.0)
        q, v = qq * q + s * v, vq * q + vv * v
    return u, time.process_time() - started


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", help="NAME.json of a scene")
    parser.add_argument("out", help="the run, .npz")
    parser.add_argument("--factor", type=int, default=4, help="steps a sample (default 4)")
    options = parser.parse_args()
    with open(options.scene, encoding="utf-8") as file:
        scene = json.load(file)
    u, cost_s = solve(scene, options.factor)
    rate_hz = scene["rate_hz"]
    about = {"solver": "examples/kicks.py", "scheme": "penalty, kick-drift", "internal_rate_hz": rate_hz * options.factor}
    np.savez(options.out, scene=scene["name"], u=u, rate_hz=rate_hz, cost_s=cost_s, **about)
