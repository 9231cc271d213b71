"""Exceptions that tell of too little memory, in the words of Python, NumPy, OpenCV, Rerun and the system's loader."""

import errno

RESERVED_BYTES = 8 << 20
"""Memory kept back for messages and for removing unfinished folders."""
WORDS = (
    "bad_alloc",
    "cannot allocate memory",
    "can't start new thread",
    "failed to map segment",
    "insufficient memory",
    "malloc of size",
    "memory allocation",
    "not enough memory",
    "out of memory",
    "resource temporarily unavailable",
    "unable to allocate",
)
"""What libraries say, in small letters, instead of raising MemoryError."""


class MemoryReserve:
    """Memory held until it is needed to report that there is none."""

    def __init__(self) -> None:
        """Reserve it; where even that is impossible, go on without."""
        try:
            self._held = bytearray(RESERVED_BYTES)
        except MemoryError:
            self._held = bytearray()

    def release(self) -> None:
        """Give it back."""
        self._held = bytearray()


def is_out_of_memory(error: BaseException | None) -> bool:
    """Return whether an exception, or one that led to it, tells of too little memory."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        if isinstance(error, MemoryError) or _names_memory(error):
            return True
        error = error.__cause__ or error.__context__
    return False


def _names_memory(error: BaseException) -> bool:
    """Return whether the number or the words of an exception of another type tell of memory."""
    if isinstance(error, OSError):
        return error.errno in (errno.ENOMEM, errno.EAGAIN)
    if type(error).__name__ == "AsfmError" or isinstance(error, KeyboardInterrupt):
        return False  # its words quote the input
    text = str(error).lower()
    return any(words in text for words in WORDS)


def has_memory_limit() -> bool:
    """Return whether the address space or the data of this process are limited (ulimit -v, -d)."""
    try:
        import resource
    except ImportError:
        return False
    kinds = (resource.RLIMIT_AS, resource.RLIMIT_DATA)
    return any(resource.getrlimit(kind)[0] != resource.RLIM_INFINITY for kind in kinds)
