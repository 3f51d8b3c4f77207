// tensegraph on an Arduino Mega 2560: twelve strain sensors on A0 to A11, read at a set rate, sent as frames; and, with
// IMU defined, an inertial sensor of the MPU-6050's kind on SDA (pin 20) and SCL (pin 21).
//
// Flash each board with its own BOARD_ID. The frames are described in io/boards/protocol.py, the wiring in docs/how-to/rig.md.

#include <avr/eeprom.h>
#include <avr/sleep.h>
#include <util/crc16.h>

#ifndef BOARD_ID
#define BOARD_ID 0
#endif
#ifndef RATE_HZ
#define RATE_HZ 50 // twelve channels take 15 ms: for more, SETTLE_US has to be less
#endif
#ifndef SETTLE_US
#define SETTLE_US 1000 // between choosing a channel and reading it, see the wiring in docs/how-to/rig.md
#endif

// #define IMU // take the slashes away if the board has an inertial sensor

const char FIRMWARE[] = "tensegraph_mega 2";
const uint8_t PROTOCOL_VERSION = 1;
const uint8_t ROW = 1, HELLO = 2, SAMPLE = 3;
const uint8_t CHANNELS = 12;
const uint32_t BAUD = 500000; // exact with a 16 MHz crystal; 115200 would be off by 2.1 %
const uint16_t TIMER_TICKS = F_CPU / 64 / RATE_HZ;
static_assert(TIMER_TICKS * 64UL * RATE_HZ == F_CPU, "RATE_HZ does not divide the timer's 250 kHz");
const uint32_t CONVERSION_US = 112; // 13 clocks of the ADC at 125 kHz, and the call
static_assert(CHANNELS * (SETTLE_US + 2 * CONVERSION_US) * RATE_HZ < 1000000, "a row takes longer than its period: choose a lower RATE_HZ or SETTLE_US");

volatile bool due = false;
volatile uint16_t ticks = 0;
uint16_t boots;

// The schedule is the timer's, not the loop's: a late loop delays a row, and never the rows after it. A row that the
// loop misses altogether is seen by the host as a gap in the counter.
ISR(TIMER1_COMPA_vect) {
  ticks++;
  due = true;
}

void start_timer() {
  TCCR1A = 0;
  TCCR1B = _BV(WGM12) | _BV(CS11) | _BV(CS10); // clear on compare match, clock / 64
  OCR1A = TIMER_TICKS - 1;
  TIMSK1 = _BV(OCIE1A);
}

uint16_t count_boot() {
  uint16_t *const cell = 0;
  const uint16_t count = eeprom_read_word(cell) + 1; // an erased cell reads 65535: the first boot is 0
  eeprom_update_word(cell, count);
  return count;
}

class Frame {
public:
  Frame(uint8_t kind) {
    put(PROTOCOL_VERSION);
    put(kind);
    put(BOARD_ID);
    put16(boots);
  }

  void put(uint8_t value) {
    bytes[length++] = value;
    crc = _crc_xmodem_update(crc, value);
  }

  void put16(uint16_t value) {
    put(value & 0xFF);
    put(value >> 8);
  }

  void put32(uint32_t value) {
    put16(value & 0xFFFF);
    put16(value >> 16);
  }

  // COBS: every zero byte becomes the distance to the next one, so that zero is free to stand between frames.
  void send() {
    put16(crc); // its own change of crc no longer matters
    uint8_t encoded[sizeof bytes + 3];
    uint8_t code_at = 1, end = 2;
    encoded[0] = 0;
    for (uint8_t k = 0; k < length; k++) {
      if (bytes[k] == 0) {
        encoded[code_at] = end - code_at;
        code_at = end++;
      } else {
        encoded[end++] = bytes[k];
      }
    }
    encoded[code_at] = end - code_at;
    encoded[end++] = 0;
    Serial.write(encoded, end);
  }

  void put_float(float value) { // IEEE 754, as on the host
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    put32(bits);
  }

private:
  uint8_t bytes[5 + 7 + 2 * CHANNELS + sizeof FIRMWARE]; // longer than any kind
  uint8_t length = 0;
  uint16_t crc = 0xFFFF;
};

#ifdef IMU
#include "imu.h"
#endif

// While the wire settles there is time for the inertial sensor: the channel is read no later for it.
void settle() {
#ifdef IMU
  const uint32_t begin_us = micros();
  if (SETTLE_US >= IMU_US) {
    serve_imu();
  }
  while (micros() - begin_us < SETTLE_US) {
  }
#else
  delayMicroseconds(SETTLE_US);
#endif
}

// The first reading only moves the hold capacitor from the last channel's voltage to this one's; what that took from
// the wire flows back through megaohms while we wait.
uint16_t read_channel(uint8_t channel) {
  analogRead(channel);
  settle();
  return analogRead(channel);
}

void send_row(uint16_t seq) {
  uint16_t code[CHANNELS];
  const uint32_t begin_us = micros();
  for (uint8_t c = 0; c < CHANNELS; c++) {
    code[c] = read_channel(c);
  }
  Frame frame(ROW);
  frame.put16(seq);
  frame.put32(begin_us + (micros() - begin_us) / 2); // the middle of the channels
  frame.put(CHANNELS);
  for (uint8_t c = 0; c < CHANNELS; c++) {
    frame.put16(code[c]);
  }
  frame.send();
}

void send_hello() {
  Frame frame(HELLO);
  frame.put32(micros());
  frame.put16(RATE_HZ);
  frame.put(CHANNELS);
  for (const char *c = FIRMWARE; *c; c++) {
    frame.put(*c);
  }
  frame.send();
}

void wait_for_tick() {
  set_sleep_mode(SLEEP_MODE_IDLE);
  for (;;) {
    cli();
    if (due) {
      due = false;
      sei();
      return;
    }
    sleep_enable();
    sei(); // takes effect after the next instruction: no tick is slept through
    sleep_cpu();
    sleep_disable();
#ifdef IMU
    if (!due && TCNT1 < TIMER_TICKS - IMU_TICKS) { // it fits in before the next row
      serve_imu();
    }
#endif
  }
}

void setup() {
  Serial.begin(BAUD);
  analogReference(DEFAULT); // the supply that feeds the dividers: codes are ratios
  boots = count_boot();
  send_hello();
#ifdef IMU
  begin_imu();
#endif
  start_timer();
}

void loop() {
  wait_for_tick();
  cli();
  const uint16_t seq = ticks - 1;
  sei();
  send_row(seq);
  if (seq % RATE_HZ == 0) {
    send_hello();
#ifdef IMU
    wake_imu();
#endif
  }
}
