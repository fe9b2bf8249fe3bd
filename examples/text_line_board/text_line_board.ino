// A board of Traverse's driver text-line: six AS5600 encoders behind a TCA9548A, two
// buttons to ground. Prints "$TRV,number,ms,c1..c6,buttons*hh" a hundred times a second.
#include <Wire.h>

const int JOINTS = 6, BUTTONS[2] = {2, 3}, PERIOD_MS = 10;
unsigned long number = 0, due = 0;

long readSensor(int first, int bytes) {  // a register of two bytes, or of one; -1: no answer
  Wire.beginTransmission(0x36);
  Wire.write(first);
  if (Wire.endTransmission(false) != 0 || Wire.requestFrom(0x36, bytes) != bytes) return -1;
  long value = Wire.read();  // high byte first
  return bytes == 1 ? value : value << 8 | Wire.read();
}

long readJoint(int joint) {  // 0 to 4095; -1: no answer; -2: no magnet
  Wire.beginTransmission(0x70);
  Wire.write(1 << joint);
  if (Wire.endTransmission() != 0) return -1;
  long status = readSensor(0x0B, 1), angle = readSensor(0x0C, 2);  // STATUS, RAW ANGLE
  if (status < 0 || angle < 0) return -1;
  return status & 0x20 ? angle & 0x0FFF : -2;  // bit MD: magnet detected
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
    if (count >= 0) n += sprintf(line + n, ",%ld", count);
    else n += sprintf(line + n, count == -1 ? ",x" : ",m");  // Traverse names the joint
  }
  for (int k = 0; k < 2; k++) pressed |= (digitalRead(BUTTONS[k]) == LOW) << k;
  n += sprintf(line + n, ",%d", pressed);
  unsigned char check = 0;
  for (int k = 1; k < n; k++) check ^= line[k];
  sprintf(line + n, "*%02X", check);
  Serial.println(line);
}
