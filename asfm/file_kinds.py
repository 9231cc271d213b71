"""Kinds of files, told by their first bytes, for messages about a file that is another than expected."""

SNIFFED_BYTES = 64
"""As many bytes of the beginning as the functions here look at."""
LFS_SIGNATURE = b"version https://git-lfs"
LFS_ADVICE = "a Git-LFS pointer instead of the file itself: fetch it with git lfs pull"
HDF5_KIND = "an HDF5 file"
SIGNATURES = (
    (LFS_SIGNATURE, LFS_ADVICE),
    (b"\xff\xd8\xff", "a JPEG image: convert it to a grey PNG"),
    (b"\x89PNG\r\n\x1a\n", "a PNG image"),
    (b"GIF8", "a GIF image: convert it to a grey PNG"),
    (b"II*\x00", "a TIFF image: convert it to a grey PNG"),
    (b"MM\x00*", "a TIFF image: convert it to a grey PNG"),
    (b"\x93NUMPY", "a NumPy array"),
    (b"\x89HDF\r\n\x1a\n", HDF5_KIND),
    (b"PK\x03\x04", "a ZIP archive: unpack it"),
    (b"\x1f\x8b", "a gzip file: unpack it"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive: unpack it"),
    (b"#ROSBAG", "a ROS bag, which is not read"),
    (b"\x89MCAP0", "an MCAP file, which is not read"),
    (b"SQLite format 3", "an SQLite database, which is not read"),
    (b"DDF\x03", "a DIDSON recording (DDF version 3), which is not read"),
    (b"DDF\x04", "a DIDSON recording (DDF version 4), which is not read"),
    (b"%PDF-", "a PDF document"),
    (b"BZh", "a bzip2 file: unpack it"),
    (b"\xfd7zXZ\x00", "an xz file: unpack it"),
    (b"\x28\xb5\x2f\xfd", "a Zstandard file: unpack it"),
    (b"Rar!\x1a\x07", "a RAR archive: unpack it"),
    (b"PK\x05\x06", "an empty ZIP archive"),
    (b"\xff\xfe", "text in UTF-16: save it as UTF-8"),
    (b"\xfe\xff", "text in UTF-16: save it as UTF-8"),
)
"""First bytes of a file, and what it is with what to do."""
MARKUP = ((b"<!doctype html", "a web page"), (b"<html", "a web page"), (b"<head", "a web page"), (b"<?xml", "XML"))
"""Beginnings of text in lower case, after blanks and a byte-order mark; a failed download leaves such a file."""
CONVERT = "convert it to a grey PNG"


def is_lfs_pointer(content: bytes) -> bool:
    """Return whether a file that begins with ``content`` is a Git-LFS pointer."""
    return content.startswith(LFS_SIGNATURE)


def name_kind(content: bytes) -> str | None:
    """Name the kind of a file by its first bytes, with what to do, or return None where it is not known."""
    if not content:
        return "an empty file"
    if content[:4] == b"RIFF":
        return {b"WEBP": f"a WebP image: {CONVERT}", b"AVI ": "an AVI video"}.get(content[8:12])
    if content[:2] == b"BM" and content[6:10] == bytes(4):
        return f"a BMP image: {CONVERT}"
    if content[:2] in (b"P2", b"P5") and content[2:3].isspace():
        return f"a PGM image: {CONVERT}"
    text = content.removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    for beginning, name in MARKUP:
        if text.startswith(beginning):
            return f"{name}: the download has failed"
    return next((name for signature, name in SIGNATURES if content.startswith(signature)), None)
