// A board of Traverse's driver text-line: six AS5600 encoders behind a TCA9548A, two
// buttons to ground. Prints "$TRV,number,ms,c1..c6,buttons*hh" a hundred times a second.
#include <Wire.h>

const int JOINTS = 6, BUTTONS[2] = {2, 3}, PERIOD_MS = 10;
unsigned long number = 0, due = 0;

long readJoint(int joint) {  // 0 to 4095; -1: no answer, and the line is not printed
  Wire.beginTransmission(0x70);
  Wire.write(1 << joint);
  if (Wire.endTransmission() != 0) return -1;
  Wire.beginTransmission(0x36);
  Wire.write(0x0C);  // raw angle, high byte first
  if (Wire.endTransmission(false) != 0 || Wire.requestFrom(0x36, 2) != 2) return -1;
  long high = Wire.read();
  return (high << 8 | Wire.read()) & 0x0FFF;
}

void setup() {
  Serial.begin(115200);
  Wire.begin();
  Wire.setClock(400000);
  for (int pin : BUTTONS) pinMode(pin, INPUT_PULLUP);
}

void loop() {
  if ((long)(millis() - due) < 0) return;
  due += PERIOD_MS;
  char line[96];
  int n = sprintf(line, "$TRV,%lu,%lu", number++, millis()), pressed = 0;
  for (int joint = 0; joint < JOINTS; joint++) {
    long count = readJoint(joint);
    if (count < 0) return;  // its number is missing: Traverse counts it as lost
    n += sprintf(line + n, ",%ld", count);
  }
  for (int k = 0; k < 2; k++) pressed |= (digitalRead(BUTTONS[k]) == LOW) << k;
  n += sprintf(line + n, ",%d", pressed);
  unsigned char check = 0;
  for (int k = 1; k < n; k++) check ^= line[k];
  sprintf(line + n, "*%02X", check);
  Serial.println(line);
}
