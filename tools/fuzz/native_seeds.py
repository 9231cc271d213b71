"""Fuzz targets of the native folder, and of the features and matches beside it."""

import io
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np

from asfm.datasets import open_sequence, open_truth
from asfm.datasets.hloc.features_matches import read_hloc, write_hloc
from asfm.datasets.hloc.image_names import name_images
from asfm.datasets.native.writer import write_native
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import Frame, FrameTruth, HandTracks, Keypoints, Matches, Navigation, Trajectory
from tools.fuzz.cases import Target

SONAR = SonarModel.evenly_spaced("seed", (0.5, 3.0), (-0.5, 0.5), (12, 8), 0.2)
FRAMES = 3
FILES = ("sequence.yaml", "frames.csv", "odometry.tum", "groundtruth.tum", "navigation.csv", "landmarks.csv")
UNEVEN = """sonar: {name: é, range_m: [0.5, 3], bearings_deg: [-30, -20, -10, -1, 1, 11, 22, 33],
  elevation_aperture_deg: 12, decibel_span: 40}
vehicle_from_sonar: {translation_m: [0.1, 0, -0.2], quaternion_xyzw: [0, 0.7071, 0, 0.7071]}
noise: {odometry: {translation_m: 0.02, rotation_deg: 1}, navigation: {z_m: 0.1, roll_deg: 1, pitch_deg: 1}}
"""
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def make_native(folder: Path) -> None:
    """Write a native folder with every file it can hold."""
    rng = np.random.default_rng(0)
    images = (rng.integers(0, 256, (FRAMES, *SONAR.shape)) / np.float32(255)).astype(np.float32)
    stamps_s = np.arange(float(FRAMES))
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 0, 3] = 0.1 * stamps_s
    sequence = Sequence(
        "seed",
        SONAR,
        stamps_s,
        lambda index: Frame(index, float(index), images[index], images[index] > 1 - 0.1 * index),
        odometry=Trajectory(stamps_s, poses),
        groundtruth=Trajectory(stamps_s, poses),
        navigation=Navigation(stamps_s, np.zeros(FRAMES), np.zeros(FRAMES), np.zeros(FRAMES)),
    )
    truth = FrameTruth(np.zeros(SONAR.shape), np.zeros(SONAR.shape, dtype=np.float32))
    write_native(folder, sequence, truth=lambda _: truth, overwrite=True)
    tracks = HandTracks(stamps_s, np.zeros(FRAMES, dtype=np.int64), np.full(FRAMES, 2.0), np.full(FRAMES, 0.1))
    rows = zip(tracks.timestamps_s, tracks.landmark, tracks.range_m, tracks.bearing_rad, strict=True)
    lines = ["timestamp_s,landmark,range_m,bearing_rad", *(",".join(map(str, row)) for row in rows)]
    (folder / "landmarks.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_native(folder: Path) -> object:
    """Read all of a native folder, as ``asfm convert`` does."""
    sequence, truth = open_sequence(folder), open_truth(folder)
    sequence.check_frames()
    return list(sequence), None if truth is None else truth(0)


def make_hloc(folder: Path) -> None:
    """Write a native folder with features.h5 and matches.h5."""
    make_native(folder)
    names = name_images(folder, open_sequence(folder))
    place = np.array([[2.0, 3.0], [5.0, 6.0], [9.0, 1.0]])
    range_m, bearing_rad = SONAR.range_at_row(place[:, 0]), SONAR.bearing_at_column(place[:, 1])
    descriptors, patches = np.zeros((3, 61), dtype=np.uint8), np.zeros((3, 3, 3), dtype=np.float32)
    keypoints = [Keypoints(place, range_m, bearing_rad, np.ones(3), descriptors, patches)] * FRAMES
    index = np.array([[0, 0], [2, 2]])
    matches = [Matches(frame, frame + 1, index, np.full(2, 0.25)) for frame in range(FRAMES - 1)]
    write_hloc(folder / "features.h5", folder / "matches.h5", names, keypoints, matches)


def read_features(folder: Path) -> object:
    """Read the features and matches beside a native folder."""
    sequence = open_sequence(folder)
    return read_hloc(folder / "features.h5", folder / "matches.h5", sequence, name_images(folder, sequence))


def correct_checksums(png: bytes) -> bytes:
    """Return a PNG file with checksums that fit its chunks, so that more than the checksum is tested."""
    parts, place = [png[:8]], 8
    while place + 12 <= len(png):
        (length,) = struct.unpack_from(">I", png, place)
        body = png[place + 4 : place + 8 + length]
        if length > len(png) or len(body) < 4:
            break
        parts.append(png[place : place + 4] + body + struct.pack(">I", zlib.crc32(body)))
        place += 12 + length
    return b"".join(parts) + png[place:]


def _zip_member(content: bytes) -> bytes:
    """Return an .npz whose elevation_rad.npy is the content, beside a valid image."""
    target, clean = io.BytesIO(), io.BytesIO()
    np.save(clean, np.zeros(SONAR.shape, dtype=np.uint8))
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("elevation_rad.npy", content)
        archive.writestr("clean.npy", clean.getvalue())
    return target.getvalue()


def _elevations(_: bytes) -> bytes:
    content = io.BytesIO()
    np.save(content, np.zeros(SONAR.shape, dtype=np.float32))
    return content.getvalue()


def _uneven(_: bytes) -> bytes:
    return UNEVEN.encode()


PNG, MASK, TRUTH = "frames/000000.png", "invalid/000001.png", "truth/000000.npz"
NATIVE_TARGETS = {
    **{name: Target(name, make_native, read_native) for name in (*FILES, PNG, MASK)},
    "uneven sequence.yaml": Target("sequence.yaml", make_native, read_native, unpack=_uneven),
    "png with checksums": Target(PNG, make_native, read_native, pack=correct_checksums),
    "mask with checksums": Target(MASK, make_native, read_native, pack=correct_checksums),
    "truth.npz": Target(TRUTH, make_native, read_native),
    "elevation_rad.npy": Target(TRUTH, make_native, read_native, pack=_zip_member, unpack=_elevations),
    "features.h5": Target("features.h5", make_hloc, read_features),
    "matches.h5": Target("matches.h5", make_hloc, read_features),
}
