"""Picture of a tool path on the seabed: surface from above, profile from the side."""

import numpy as np
from matplotlib.figure import Figure

from uuv.perception.seabed.terrain_path import SeabedPlan


def picture(plan: SeabedPlan) -> Figure:
    """Plan view with the mesh coloured by standard error, and the profile with its axes."""
    terrain = plan.terrain
    ground, A = terrain.ground(terrain.vertices), terrain.ground(plan.targets.A)

    figure = Figure(figsize=(9, 9.5), layout="compressed")
    above, aside = figure.subplots(2, 1, height_ratios=(3, 1.4))

    # The surface, its targets and its profile from above.
    colour = above.tripcolor(
        ground[:, 0], ground[:, 1], terrain.triangles, 1e3 * terrain.sigma, shading="gouraud"
    )
    figure.colorbar(colour, ax=above, label="standard error of the height [mm]")
    above.triplot(ground[:, 0], ground[:, 1], terrain.triangles, lw=0.1, color="k")
    above.plot(A[:, 0], A[:, 1], "r^", label="targets $A_i$")
    above.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="surface from above")
    if plan.profile is not None and plan.path is not None:
        T, a, n = (
            p_W @ terrain.R_ground.T for p_W in (plan.profile.T, plan.profile.a, plan.profile.n)
        )
        above.plot(T[:, 0], T[:, 1], "r-", lw=1, label="profile")

        # The profile from the side, over its length.
        along = np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(T[:, :2], axis=0), axis=1))]
        )
        path = terrain.ground(plan.path.p)
        far = np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1))]
        )
        aside.plot(far, path[:, 2], "-", color="0.6", lw=3, label="cubic B-spline")
        aside.plot(along, T[:, 2], "k.", ms=4, label="$T_j$")
        way = np.gradient(T[:, :2], axis=0)
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-12)

        # Axes of the tool at some points.
        for vectors, shade, label in ((a, "tab:blue", "$a_j$"), (n, "tab:red", "$n_j$")):
            level = np.einsum("ij,ij->i", vectors[:, :2], way)
            some = slice(None, None, max(1, len(T) // 15))
            aside.quiver(
                along[some],
                T[some, 2],
                level[some],
                vectors[some, 2],
                color=shade,
                label=label,
                width=0.003,
                angles="xy",
                scale_units="xy",
                scale=18.0 / along[-1],
            )

        aside.plot(along[plan.profile.target], T[plan.profile.target, 2], "r^")
        aside.set(
            aspect="equal", xlabel="along the profile [m]", ylabel="height [m]", title="profile"
        )
        middle = float(np.mean([T[:, 2].min(), T[:, 2].max()]))
        half = max(0.75 * float(np.ptp(T[:, 2])), 0.15 * along[-1], 0.06)
        aside.set_ylim(middle - half, middle + half)
        aside.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))

    # the location "best" is slow for thousands of points
    above.legend(fontsize="small", loc="upper right")
    return figure
