import re
import subprocess
from pathlib import Path

import pytest

from traverse.drivers.text_line.line import Line, LinePattern, OddLine

ROOT = Path(__file__).parents[3]
SKETCH = ROOT / "examples/text_line_board/text_line_board.ino"
PAGE = ROOT / "docs/drivers/text-line.md"
# What the sketch uses of Arduino: encoder k shows 100 k + 5, then the third is gone;
# at the end the fifth lacks its magnet.
ARDUINO = r"""
#include <cstdio>
const int INPUT_PULLUP = 2, LOW = 0;
static unsigned long now = 42;
static int channel, asked, gone, bare;
unsigned long millis() { return now; }
void pinMode(int, int) {}
int digitalRead(int pin) { return pin == 3 ? LOW : 1; }
struct { void begin(long) {} void println(const char *s) { puts(s); } } Serial;
struct {
  void begin() {} void setClock(long) {}
  int address;
  void beginTransmission(int a) { address = a; }
  void write(int b) { if (address == 0x70) channel = __builtin_ctz(b); else asked = b; }
  int endTransmission(bool = true) { return gone && channel == 2 && address == 0x36; }
  int requestFrom(int, int n) { return asked == (n == 1 ? 0x0B : 0x0C) ? n : 0; }
  int half = 0;
  int value() { return 100 * channel + 5; }
  int read() {
    if (asked == 0x0B) return bare && channel == 4 ? 0x10 : 0x20;
    return (half ^= 1) ? 0xF0 | value() >> 8 : value() & 255;
  }
} Wire;
"""
MAIN = """
int main() {
  setup();
  loop(); now += 10; loop(); now += 10;
  gone = 1; loop(); gone = 0; now += 10; loop();
  bare = 1; now += 10; loop();
}
"""


@pytest.mark.needs("cplusplus")
def test_what_the_sketch_prints_is_read_by_the_pattern_of_its_page(tmp_path):
    (tmp_path / "Wire.h").write_text("#pragma once\n" + ARDUINO, "utf-8")
    main = f'#include "Wire.h"\n{SKETCH.read_text("utf-8")}\n{MAIN}'
    (tmp_path / "main.cpp").write_text(main, "utf-8")
    words = ["g++", "-Wall", "-Werror", "-I", ".", "main.cpp", "-o", "board"]
    subprocess.run(words, cwd=tmp_path, check=True)
    printed = subprocess.run(
        [tmp_path / "board"], check=True, capture_output=True
    ).stdout.splitlines()
    pattern = re.search(r'^pattern = "(.*)"$', PAGE.read_text("utf-8"), re.M)
    assert pattern is not None
    read = LinePattern(pattern[1], "counts", (4096,) * 6, checksum="xor").read
    counts = tuple(100 * k + 5 for k in range(6))
    assert [read(line) for line in printed] == [
        Line(counts, 42, 0, 2),
        Line(counts, 52, 1, 2),
        OddLine("says that joint 3 does not answer"),
        Line(counts, 72, 3, 2),
        OddLine("says that joint 5 has no magnet"),
    ]
