"""The README's pictures, from a demo drive: one frame, and the timeline.

usage: pictures.py DRIVE [FOLDER]
"""

import sys
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np

from recorder import open_drive
from recorder.storage import Drive

mpl.use("Agg")
from matplotlib import pyplot as plt


def frame_picture(drive: Drive, path: Path) -> None:
    """The middle frame, brightened for the eye (gamma 1.4), half size."""
    frames = drive.frames("front")
    frame = frames[len(frames) // 2]
    shown = 255 * (frame.pixels / ((1 << frame.bit_depth) - 1)) ** (1 / 1.4)
    small = cv2.resize(shown.astype(np.float32), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path), small.astype(np.uint8))


def timeline_picture(drive: Drive, path: Path) -> None:
    """When each topic spoke, and how well UTC was known."""
    topics = sorted(drive.topics)
    start = min(topic.first_ns for topic in drive.topics.values())
    figure, (rows, sigma) = plt.subplots(
        2, 1, figsize=(10, 4.8), sharex=True, height_ratios=[4, 1.2], layout="constrained"
    )
    for row, name in enumerate(topics):
        times = (np.array([int(entry["log_time"]) for entry in drive.entries(name)]) - start) / 1e9
        rows.eventplot(times, lineoffsets=row, linelengths=0.7, linewidths=0.6, colors=f"C{row % 10}")
        rows.text(1.01, row, f"{len(times)}", transform=rows.get_yaxis_transform(), va="center", fontsize=8)
    rows.set_yticks(range(len(topics)), topics, fontsize=8)
    rows.invert_yaxis()
    rows.set_title(f"drive {drive.path.name}: every message of every topic (right: how many)", fontsize=10)
    utc = [message.value for message in drive.messages("/time/utc")]
    seconds = [(message.raw_ns + drive.log_offset_ns - start) / 1e9 for message in utc]
    sigma.plot(seconds, [message.sigma_ns / 1e6 for message in utc], ".-", color="C3")
    sigma.set_ylabel("UTC ± ms", fontsize=8)
    sigma.set_ylim(0, 1.3 * max(message.sigma_ns for message in utc) / 1e6)
    sigma.set_xlabel("seconds", fontsize=8)
    for axes in (rows, sigma):
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Both pictures."""
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("docs/pictures")
    folder.mkdir(parents=True, exist_ok=True)
    with open_drive(Path(sys.argv[1])) as drive:
        frame_picture(drive, folder / "demo-frame.png")
        timeline_picture(drive, folder / "timeline.png")


if __name__ == "__main__":
    main()
