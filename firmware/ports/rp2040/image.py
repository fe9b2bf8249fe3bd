"""Make a UF2 file for a Pico of the program's flash image; add the boot stage's CRC.

Usage: image.py FLASH.bin OUT.uf2 (which also writes the CRC into FLASH.bin).
"""

import struct
import sys
from pathlib import Path

FLASH = 0x10000000
BOOT2_BYTES = 256
BLOCK_BYTES = 256
RP2040 = 0xE48BFF56  # UF2's family
FAMILY_GIVEN = 0x2000
MAGIC = (0x0A324655, 0x9E5D5157, 0x0AB16F30)


def boot_crc(data: bytes) -> int:
    """CRC-32 of the ROM: polynomial 04C11DB7, initial value all ones, not reflected."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ (0x04C11DB7 if crc & 0x80000000 else 0)) & 0xFFFFFFFF
    return crc


def uf2(image: bytes) -> bytes:
    """Blocks of 256 bytes, each with its address in flash."""
    n_blocks = -(-len(image) // BLOCK_BYTES)
    blocks = []
    for n in range(n_blocks):
        data = image[n * BLOCK_BYTES : (n + 1) * BLOCK_BYTES].ljust(BLOCK_BYTES, b"\0")
        head = struct.pack(
            "<8I",
            *MAGIC[:2],
            FAMILY_GIVEN,
            FLASH + n * BLOCK_BYTES,
            BLOCK_BYTES,
            n,
            n_blocks,
            RP2040,
        )
        blocks.append(head + data.ljust(476, b"\0") + struct.pack("<I", MAGIC[2]))
    return b"".join(blocks)


def main() -> None:
    source, target = map(Path, sys.argv[1:])
    image = source.read_bytes()
    boot2 = image[: BOOT2_BYTES - 4]
    image = boot2 + struct.pack("<I", boot_crc(boot2)) + image[BOOT2_BYTES:]
    source.write_bytes(image)
    target.write_bytes(uf2(image))


main()
