"""Blueprint of a recording: the views of the Rerun viewer, their layout and what they show at first."""

from collections.abc import Collection
from typing import Any

from asfm.visualization.colours import TRAJECTORY_NAMES
from asfm.visualization.overlays import HIDDEN
from asfm.visualization.viewpoint import Viewpoint

TAIL_FRAMES = 10
"""Tracks are shown over this many frames."""


def build_blueprint(viewpoint: Viewpoint, trajectories: Collection[str], step_s: float) -> Any:
    """Build the layout: images left, the world right, summary and curves below it.

    Args:
        viewpoint: of the 3-D view.
        trajectories: names of the trajectories drawn; with "groundtruth", the drift is plotted too.
        step_s: typical time between two frames.

    Returns:
        A Rerun blueprint.
    """
    from rerun import blueprint as rrb

    below = [
        rrb.TextDocumentView(origin="summary", name="Summary"),
        rrb.TimeSeriesView(origin="counts", name="Found in each frame"),
    ]
    if "groundtruth" in trajectories:
        name, corner = "Distance from ground truth (m)", rrb.Corner2D.LeftTop
        below.append(rrb.TimeSeriesView(origin="drift", name=name, plot_legend=corner))
    right = rrb.Vertical(
        _view_world(viewpoint, trajectories, step_s),
        rrb.Horizontal(*below, column_shares=[4, 3, 3]),
        row_shares=[2, 1],
    )
    layout = rrb.Horizontal(_view_images(step_s), right, column_shares=[1, 2])
    panels = rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed")
    time = rrb.TimePanel(state="collapsed", timeline="frame", fps=10.0, play_state="following")
    return rrb.Blueprint(layout, *panels, time)


def _view_images(step_s: float) -> Any:
    """Show each frame twice: with keypoints and matches, and with tracks."""
    from rerun import blueprint as rrb

    found, tracked = ["$origin/**", "- $origin/tracks"], ["$origin/image", "$origin/tracks"]
    hidden = dict.fromkeys(HIDDEN, rrb.EntityBehavior(visible=False))
    return rrb.Vertical(
        rrb.Tabs(
            rrb.Spatial2DView(origin="fan", contents=found, name="Fan: echoes, keypoints, matches", overrides=hidden),
            rrb.Spatial2DView(origin="polar", name="Polar image", overrides=hidden),
        ),
        rrb.Spatial2DView(
            origin="fan",
            contents=tracked,
            name=f"Fan: tracks over {TAIL_FRAMES} frames",
            overrides={"fan/tracks": _show_last(TAIL_FRAMES, step_s)},
        ),
    )


def _view_world(viewpoint: Viewpoint, trajectories: Collection[str], step_s: float) -> Any:
    """Show landmarks and trajectories over a grid that gives the scale."""
    from rerun import blueprint as rrb
    from rerun.components import Plane3D

    return rrb.Spatial3DView(
        origin="world",
        name=f"World: {', '.join([*(TRAJECTORY_NAMES[name] for name in trajectories), 'grid of 1 m'])}",
        overrides={"world/so_far": _show_last(None, step_s)},
        line_grid=rrb.LineGrid3D(spacing=1.0, plane=Plane3D.XY.with_distance(viewpoint.floor_m)),
        eye_controls=rrb.EyeControls3D(
            position=viewpoint.eye_m, look_target=viewpoint.target_m, eye_up=[0.0, 0.0, 1.0]
        ),
    )


def _show_last(frames: int | None, step_s: float) -> Any:
    """Show what was logged during the last frames, or since the beginning (None), on both timelines."""
    from rerun.blueprint import TimeRangeBoundary, VisibleTimeRange, VisibleTimeRanges

    now, beginning = TimeRangeBoundary.cursor_relative(seq=0), TimeRangeBoundary.infinite()
    starts = {"frame": beginning, "time": beginning}
    if frames is not None:
        starts["frame"] = TimeRangeBoundary.cursor_relative(seq=1 - frames)
        starts["time"] = TimeRangeBoundary.cursor_relative(seconds=(0.5 - frames) * step_s)
    return VisibleTimeRanges([VisibleTimeRange(name, start=start, end=now) for name, start in starts.items()])
