"""The records of an MCAP file, up to its end or to where it is torn."""

import struct
from collections.abc import Iterator
from os import fstat
from typing import IO

import zstandard
from mcap.exceptions import InvalidMagic, McapError
from mcap.records import McapRecord, Message, Statistics
from mcap.stream_reader import StreamReader

PROFILE = "traverse"
"""Profile in the headers of all our files."""
# Longer records are garbage: memory is requested only for what can be there.
_LONGEST_RECORD = 1 << 28
# Whatever garbage does to the decoder of records; what is between records is ours.
_TORN = (
    EOFError,
    McapError,
    struct.error,
    ValueError,
    OverflowError,
    MemoryError,
    zstandard.ZstdError,
    RuntimeError,
)


class _Whole:
    """Return as many bytes as requested, or none."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self._file = file
        self._size = size
        self.n_read = 0

    def read(self, length: int) -> bytes:
        missing = length - (self._size - self.n_read)
        if missing > 0:
            raise EOFError(f"the file ends {missing} bytes too early")
        content = self._file.read(length)
        self.n_read += length
        return content


class TornRecords:
    """Goes through the records of a file; chunks are checked by their CRC.

    Whether messages are missing, as where the kind of a record was altered, is known in
    the end, by their count.

    Attributes:
        tear: Why the records end before the file does, or None.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._source = _Whole(file, fstat(file.fileno()).st_size)
        self.tear: str | None = None

    def __iter__(self) -> Iterator[McapRecord]:
        """Iterate over the records.

        Raises:
            ValueError: It is no MCAP file at all.
        """
        reader = StreamReader(
            self._source,  # type: ignore[arg-type] # it only reads
            validate_crcs=True,
            record_size_limit=_LONGEST_RECORD,
        )
        records = iter(reader.records)
        n_records = n_messages = 0
        while True:
            try:
                record = next(records)
            except StopIteration:
                return
            except _TORN as error:
                if n_records == 0 and isinstance(error, InvalidMagic | EOFError):
                    raise ValueError("is no MCAP file; expected a recording") from error
                why = str(error) or type(error).__name__
                self.tear = f"torn after {self._source.n_read} bytes: {why}"
                return
            n_records += 1
            if isinstance(record, Message):
                n_messages += 1
            elif isinstance(record, Statistics) and record.message_count != n_messages:
                counted = f"{n_messages} of {record.message_count} messages are there"
                self.tear = f"torn: {counted}"
            yield record
