#!/usr/bin/env python3
"""Drives a plan's torques, open loop, into the same arm in Exudyn and compares force and tip.

    python compare.py out/plan --arm examples/arm.toml

Exudyn's ANCF cable is a geometrically exact beam of other authors: what differs is the plan's error
where a link really bends. Exit codes: 0 done, 1 Exudyn could not do it, 2 command line or file at fault.
"""

import argparse
import csv
import json
import sys
from pathlib import Path

import numpy as np

from plan_files import FileError, check_arm, read_arm, read_plan
from plant import PlantError, Settings, respond

# The arm that `flexor plan` takes without --arm.
PAPER_ARM = Path(__file__).resolve().parents[2] / "examples" / "arm.toml"
# The first torques are held so long before the plan begins, s: what is wrong with the start shows there.
HOLD_S = 0.1
# Bent shapes in the picture, evenly along the path.
SHAPES = 7


def arguments():
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])

    def number(least, most, accepted):
        def parse(text):
            try:
                value = float(text)
            except ValueError:
                value = float("nan")
            if not least <= value <= most:
                raise argparse.ArgumentTypeError(f"{text}: {accepted} from {least:g} to {most:g} is accepted")
            return value

        return parse

    def elements(text):
        value = number(1, 1000, "a whole number")(text)
        if value != int(value):
            raise argparse.ArgumentTypeError(f"{text}: a whole number from 1 to 1000 is accepted")
        return int(value)

    add = parser.add_argument
    add("plan", metavar="PLAN", type=Path, help="folder that `flexor plan` wrote, or a plan's CSV")
    add("--arm", metavar="FILE", type=Path, help=f"the plan's arm; without it the paper's [{PAPER_ARM.name}]")
    add("--any-arm", action="store_true", help="go on with an arm that the plan was not made for")
    add(
        "--bending-damping",
        metavar="S",
        type=number(0, 10, "a time in s"),
        help="retardation time of link 2's bending, s; without it the arm's link2.bending_damping_s, or else "
        "2 damping_ratio / omega_1",
    )
    add("--elements", metavar="N", type=elements, default=16, help="cable elements of link 2 [16]")
    add(
        "--axial-stiffness",
        metavar="N",
        type=number(1, 1e12, "a force in N"),
        default=1e6,
        help="EA of Exudyn's link 2, N, which stretches where the plan's does not; by how much is printed "
        "[1e6]",
    )
    add(
        "--step",
        metavar="S",
        type=number(1e-7, 1e-2, "a time in s"),
        default=1e-4,
        help="Exudyn's time step, s [1e-4]",
    )
    add(
        "--interpolation",
        choices=["linear", "cubic"],
        default="linear",
        help="of the torques between the plan's ticks; cubic for plans with few of them [linear]",
    )
    add(
        "--normal-force-N",
        metavar="N",
        type=number(1e-9, 1e6, "a force in N"),
        help="planned force, for a CSV without the column normal_force_N",
    )
    add(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("out/exudyn"),
        help="folder for the results [out/exudyn]",
    )
    add("--json", action="store_true", help="print one JSON object instead of text")
    return parser.parse_args()


def compare(arm, plan, response):
    """Planned and measured over the plan's time: a dict of columns, and one of the figures."""
    k = response.t >= plan.t[0] - 1e-9
    t, tip = response.t[k], response.tip[k]
    planned_tip, planned_force = plan.smooth(plan.tip, t), plan.smooth(plan.normal_force, t)
    angle, root = plan.smooth(plan.angle, t), plan.smooth(plan.root_slope, t)
    along = 1e3 * (tip - planned_tip) @ plan.direction
    across = 1e3 * (tip - planned_tip) @ response.normal
    force_error = response.force[k] - planned_force
    chord = np.hypot(*(tip - response.nodes[k][:, 0]).T)
    columns = {
        "t_s": t,
        "normal_force_N": response.force[k],
        "planned_normal_force_N": planned_force,
        "tip_x1_m": tip[:, 0],
        "tip_x2_m": tip[:, 1],
        "planned_x1_m": planned_tip[:, 0],
        "planned_x2_m": planned_tip[:, 1],
        "tip_error_along_mm": along,
        "theta10_rad": response.theta10[k],
        "planned_theta10_rad": angle[:, 0],
        "root_tangent_rad": response.root_tangent[k],
        "planned_root_tangent_rad": angle[:, 1] + root,
        "root_tangent_rate_rad_s": response.root_rate[k],
        "chord_m": chord,
    }
    figures = {
        "force_error_rms_N": np.sqrt((force_error**2).mean()),
        "force_error_max_N": np.abs(force_error).max(),
        "tip_error_along_rms_mm": np.sqrt((along**2).mean()),
        "tip_error_along_max_mm": np.abs(along).max(),
        "tip_error_along_at_rest_mm": along[0],
        "tip_error_along_at_end_mm": along[-1],
        "tip_error_across_max_mm": np.abs(across).max(),
        "chord_min_m": chord.min(),
        "stretch_max_mm": 1e3 * np.abs(response.stretch[k]).max() * arm.link2_length,
    }
    return columns, {name: float(value) for name, value in figures.items()}


def write_csv(path, columns, plan):
    """The response at the plan's ticks."""
    at = {name: np.interp(plan.t, columns["t_s"], values) for name, values in columns.items()}
    at["t_s"] = plan.t
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(at)
        writer.writerows([f"{value:.9g}" for value in row] for row in zip(*at.values(), strict=True))


def picture(path, columns, arm, plan, response, title):
    """Forces, tip error, and the arm at some moments."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplot_mosaic(
        [["force", "arm"], ["tip", "arm"]], figsize=(11, 6), layout="constrained"
    )
    figure.suptitle(title)
    t = columns["t_s"]
    axes["force"].plot(t, columns["normal_force_N"], label="Exudyn")
    axes["force"].plot(t, columns["planned_normal_force_N"], "k--", linewidth=1, label="plan")
    axes["force"].set(ylabel="contact force, N")
    axes["force"].legend()
    axes["tip"].plot(t, columns["tip_error_along_mm"])
    axes["tip"].axhline(0, color="k", linestyle="--", linewidth=1)
    axes["tip"].set(xlabel="time, s", ylabel="tip ahead of the plan, mm")
    # Forces and places that agree to rounding are not drawn as if they did not.
    for name, least in (("force", 0.01 * np.abs(plan.normal_force).max()), ("tip", 0.01)):
        low, high = axes[name].get_ylim()
        if high - low < least:
            middle = (low + high) / 2
            axes[name].set_ylim(middle - least / 2, middle + least / 2)
    view, surface = axes["arm"], plan.tip[[0, -1]]
    view.plot(*surface.T, "k", linewidth=1, label="surface")
    progress = (plan.tip - plan.tip[0]) @ plan.direction / np.hypot(*(plan.tip[-1] - plan.tip[0]))
    moving = np.maximum.accumulate(progress)
    for part in np.linspace(0, 1, SHAPES):
        moment = plan.t[min(np.searchsorted(moving, part - 1e-6, side="right"), len(plan.t) - 1)]
        row = min(round((moment - response.t[0]) / (response.t[1] - response.t[0])), len(response.t) - 1)
        joint2, planned = response.nodes[row, 0], plan.smooth(plan.tip, moment)
        colour = pyplot.get_cmap("viridis")(0.9 * part)
        view.plot([0, joint2[0]], [0, joint2[1]], color="0.8", linewidth=3, zorder=0)
        view.plot(*response.shape(row, arm).T, color=colour, label=f"{moment:.2f} s")
        view.plot(*planned, "+", color=colour, markersize=9)
    view.set(xlabel="a1, m", ylabel="a2 (down), m", title="the arm; + planned tip")
    view.set_aspect("equal")
    view.invert_yaxis()
    view.legend(fontsize="small")
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


def text(figures):
    """The table that is printed."""
    f = figures
    rows = [
        ("force", f"error {f['force_error_rms_N']:.5f} N rms, {f['force_error_max_N']:.5f} N at most"),
        (
            "tip along the path",
            f"error {f['tip_error_along_rms_mm']:.4f} mm rms, {f['tip_error_along_max_mm']:.4f} mm at most; "
            f"{f['tip_error_along_at_rest_mm']:.4f} mm at the start, "
            f"{f['tip_error_along_at_end_mm']:.4f} mm at the end",
        ),
        ("tip across it", f"{f['tip_error_across_max_mm']:.1g} mm at most: held by the surface"),
        (
            "chord",
            f"down to {1e3 * f['chord_min_m']:.2f} of {1e3 * f['link2_length_m']:.2f} mm; Exudyn's link "
            f"stretches {f['stretch_max_mm']:.1g} mm",
        ),
        ("surface", "on the side of ({:.4g}, {:.4g})".format(*f["surface_normal"])),
        (
            "Exudyn",
            f"{f['elements']} cable elements, step {f['step_s']:g} s, "
            f"bending damping {f['bending_damping_s']:.4g} s, "
            f"{f['plan_s']:.3f} s of plan in {f['seconds']:.1f} s",
        ),
    ]
    return "\n".join(f"{name:<20}{value}" for name, value in rows)


def main():
    """Reads, drives, writes. Returns the exit code."""
    options = arguments()
    path = options.plan / "plan.csv" if options.plan.is_dir() else options.plan
    arm_path = options.arm or PAPER_ARM
    try:
        arm = read_arm(arm_path)
        if not options.any_arm:
            check_arm(path.parent, arm, arm_path)
        plan = read_plan(path, arm, options.normal_force_N, options.interpolation)
        damping = options.bending_damping
        if damping is None:
            damping = arm.bending_damping_s
        if damping is None:
            damping = arm.matched_bending_damping_s()
        settings = Settings(damping, options.elements, options.axial_stiffness, options.step, HOLD_S)
        response, seconds = respond(arm, plan, settings)
        options.out.mkdir(parents=True, exist_ok=True)
        columns, figures = compare(arm, plan, response)
        write_csv(options.out / "response.csv", columns, plan)
        picture(options.out / "comparison.png", columns, arm, plan, response, f"{path} in Exudyn, open loop")
    except (FileError, PlantError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1 if isinstance(error, PlantError) else 2
    figures |= {
        "link2_length_m": arm.link2_length,
        "surface_normal": [float(value) for value in response.normal],
        "elements": settings.elements,
        "axial_stiffness_N": settings.axial_stiffness,
        "step_s": settings.step_s,
        "bending_damping_s": damping,
        "plan_s": float(plan.t[-1] - plan.t[0]),
        "seconds": seconds,
    }
    if options.json:
        print(json.dumps(figures, indent=2))
    else:
        print(f"{path} with the arm of {arm_path}\n\n{text(figures)}\n")
        print(f"response.csv and comparison.png are in {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
