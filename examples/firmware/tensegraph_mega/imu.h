// An inertial sensor of the MPU-6050's kind (MPU-6000, 6500, 9250, ICM-20689: they have these registers in common) on the
// I2C bus, read at a set rate in the pauses between the readings of strain sensors.
//
// A sensor that is unplugged costs the strain sensors nothing: it sends no samples until it answers again.

#include <Wire.h>

#ifndef IMU_RATE_HZ
#define IMU_RATE_HZ 100
#endif
#ifndef IMU_ADDRESS
#define IMU_ADDRESS 0x68 // 0x69 where its pin AD0 is high
#endif

const uint8_t IMU_SENSOR = 0; // its number on this board
const uint32_t IMU_PERIOD_US = 1000000 / IMU_RATE_HZ;
const uint16_t IMU_US = 900; // longest time that it takes to read a sample, or to send it
const uint16_t IMU_TICKS = IMU_US / 4;
const uint32_t IMU_TIMEOUT_US = 700; // a transfer takes 0.5 ms: a bus that hangs is given up
const uint16_t IMU_DELAY_US = 4900;  // of its low-pass filter: the middle of a sample is that old when it is read

const uint8_t ACCELERATIONS = 0x3B; // seven big-endian integers: three accelerations, temperature, three rates
const uint8_t POWER = 0x6B, POWER_ON = 0x01; // awake, by the clock of a gyroscope; some sensors sleep after power-up
const uint8_t FILTER = 0x1A, FORCE_FILTER = 0x1D, FILTER_44_HZ = 3; // an MPU-6050 has the first alone, for both
const uint8_t RATE_RANGE = 0x1B, RATE_1000_DEG_PER_S = 0x10;
const uint8_t FORCE_RANGE = 0x1C, FORCE_8_G = 0x10;
const float RATE_UNIT_RAD_PER_S = 1000.0 / 32768 * DEG_TO_RAD;
const float FORCE_UNIT_M_PER_S2 = 8 * 9.80665 / 32768;

bool imu_is_awake = false;
bool imu_has_sample = false; // that was read and is not yet sent
uint16_t imu_integer[7];
uint16_t imu_seq = 0;
uint32_t imu_read_us = 0;
uint32_t imu_due_us = 0;

bool write_imu(uint8_t address, uint8_t value) {
  Wire.beginTransmission(IMU_ADDRESS);
  Wire.write(address);
  Wire.write(value);
  return Wire.endTransmission() == 0;
}

bool request_imu(uint8_t address, uint8_t count) {
  return Wire.requestFrom((uint8_t)IMU_ADDRESS, count, (uint32_t)address, (uint8_t)1, (uint8_t)true) == count;
}

bool imu_has(uint8_t address, uint8_t value) { return request_imu(address, 1) && Wire.read() == value; }

// Once a second: a sensor that lost its power, for however short a time, may sleep and has other ranges and filters.
void wake_imu() {
  const bool was_awake = imu_is_awake;
  const bool is_set_up = imu_has(POWER, POWER_ON) && imu_has(FILTER, FILTER_44_HZ) &&
                         imu_has(RATE_RANGE, RATE_1000_DEG_PER_S) && imu_has(FORCE_RANGE, FORCE_8_G);
  imu_is_awake = is_set_up || (write_imu(POWER, POWER_ON) && write_imu(FILTER, FILTER_44_HZ) &&
                               write_imu(FORCE_FILTER, FILTER_44_HZ) && write_imu(RATE_RANGE, RATE_1000_DEG_PER_S) &&
                               write_imu(FORCE_RANGE, FORCE_8_G));
  if (imu_is_awake && !was_awake) {
    imu_due_us = micros(); // it stood still, and micros() may have wrapped meanwhile
  }
}

void begin_imu() {
  Wire.begin();
  Wire.setClock(400000);
  Wire.setWireTimeout(IMU_TIMEOUT_US, true);
  wake_imu();
}

void read_imu() {
  const uint32_t late_us = micros() - imu_due_us;
  if (late_us > UINT32_MAX / 2) {
    return; // it is not yet time
  }
  imu_read_us = imu_due_us + late_us;
  imu_due_us = late_us < IMU_PERIOD_US ? imu_due_us + IMU_PERIOD_US : imu_read_us + IMU_PERIOD_US;
  imu_is_awake = imu_has_sample = request_imu(ACCELERATIONS, sizeof imu_integer);
  for (uint8_t k = 0; k < 7 && imu_has_sample; k++) {
    const uint8_t high = Wire.read();
    imu_integer[k] = (uint16_t)high << 8 | (uint8_t)Wire.read();
  }
}

void send_sample() {
  Frame frame(SAMPLE);
  frame.put16(imu_seq++);
  frame.put32(imu_read_us - IMU_DELAY_US + IMU_PERIOD_US / 2); // the end of the time of which it is the mean
  frame.put(IMU_SENSOR);
  frame.put_float(RATE_UNIT_RAD_PER_S);
  frame.put_float(FORCE_UNIT_M_PER_S2);
  for (uint8_t axis = 0; axis < 3; axis++) {
    frame.put16(imu_integer[4 + axis]);
  }
  for (uint8_t axis = 0; axis < 3; axis++) {
    frame.put16(imu_integer[axis]);
  }
  frame.send();
  imu_has_sample = false;
}

// Called in each pause of at least IMU_US: a sample is read in one pause and sent in the next.
void serve_imu() {
  if (imu_has_sample) {
    send_sample();
  } else if (imu_is_awake) {
    read_imu();
  }
}
