/* A Mega 2560 that runs real firmware in simavr, as a serial port: its UART is a pty, its analog inputs follow a file.
 *
 *   board FIRMWARE.elf LINK VOLTAGES.csv [RATE_PPM [EEPROM [LOG [SAMPLES.csv [POWER RATE_RANGE FORCE_RANGE]]]]]
 *
 * LINK becomes a symbolic link to the pty. VOLTAGES.csv holds t_s and one column of millivolts a channel, no header;
 * it is played by the board's own clock, again from the start at its end. RATE_PPM is how much too fast that clock
 * runs. EEPROM keeps the boot counter from one start to the next. LOG gets a line "sequence monotonic_s" whenever a
 * frame's last byte has left. SAMPLES.csv puts an MPU-6050 on the I2C bus: it holds t_s, three accelerations, a
 * temperature and three rates, as in the sensor's registers with the ranges of 8 g and 1000 degrees a second. POWER and
 * the ranges are what these registers hold at its start: 64, asleep, and zeros if not given; 1 is the power register of
 * an MPU-9250. SIGUSR1 takes the sensor off the bus, and puts it back.
 *
 * What simavr leaves out, and firmware for megaohm sources has to cope with, is added here: the hold capacitor and the
 * wire share their charge when a channel is chosen, and the wire recovers through the source.
 *
 * A test tool, not part of the wheel: simavr is GPL-3.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <pty.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_twi.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

enum { CHANNELS = 16, EEPROM_BYTES = 4096, SLICE_US = 500, REGISTER_ADCL = 0x78, REGISTER_ADMUX = 0x7C,
       REGISTER_ADCSRB = 0x7B };
static const double F_CPU_HZ = 16e6, HOLD_F = 14e-12, WIRE_F = 60e-12, SOURCE_OHM = 2.9e6, SUPPLY_MV = 5000.0;

typedef struct {
  double *cells;
  int rows, columns;
} table_t;

static table_t voltages, samples;
static avr_t *avr;
static double hold_mv, wire_mv[CHANNELS];
static avr_cycle_count_t settled_cycle[CHANNELS];
static int chosen = -1;
static avr_io_read_t read_adcl;
static unsigned char out[4096];
static size_t out_length;
static volatile sig_atomic_t stop, sensor_is_off;

static void on_signal(int number) { (void)number; stop = 1; }

static void on_plug(int number) { (void)number; sensor_is_off = !sensor_is_off; }

static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec + 1e-9 * t.tv_nsec;
}

static void die(const char *what) {
  fprintf(stderr, "board: %s: %s\n", what, strerror(errno));
  exit(1);
}

static table_t read_table(const char *path) {
  table_t table = {0};
  FILE *file = fopen(path, "r");
  char line[1024];
  if (!file) die(path);
  while (fgets(line, sizeof line, file)) {
    table.columns = 0;
    for (char *cell = strtok(line, ","); cell; cell = strtok(NULL, ",")) table.columns++;
    table.rows++;
  }
  table.cells = calloc((size_t)table.rows * table.columns, sizeof *table.cells);
  rewind(file);
  for (int k = 0; fgets(line, sizeof line, file); k++) {
    int c = 0;
    for (char *cell = strtok(line, ","); cell && c < table.columns; cell = strtok(NULL, ","))
      table.cells[k * table.columns + c++] = atof(cell);
  }
  fclose(file);
  return table;
}

static double played(const table_t *table, int column) {
  const double first = table->cells[0], last = table->cells[(table->rows - 1) * table->columns];
  const double t = first + fmod(avr->cycle / F_CPU_HZ, last - first + 1e-9);
  int low = 0, high = table->rows - 1;
  while (high - low > 1) {
    int middle = (low + high) / 2;
    if (table->cells[middle * table->columns] <= t) low = middle; else high = middle;
  }
  return column + 1 < table->columns ? table->cells[low * table->columns + column + 1] : 0.0;
}

static void settle(int channel, double source, double capacitance_f) {
  const double since_s = (avr->cycle - settled_cycle[channel]) / F_CPU_HZ;
  wire_mv[channel] += (source - wire_mv[channel]) * (1 - exp(-since_s / (SOURCE_OHM * capacitance_f)));
  settled_cycle[channel] = avr->cycle;
}

/* Called when firmware reads ADCL, once a conversion: simavr 1.6 knows eight of the sixteen channels, and no charge. */
static uint8_t on_adcl(avr_t *a, avr_io_addr_t address, void *parameter) {
  const int channel = (a->data[REGISTER_ADMUX] & 7) | (a->data[REGISTER_ADCSRB] & 8);
  const double source = played(&voltages, channel);
  if (channel != chosen) { /* the hold capacitor brings the last channel's voltage along */
    settle(channel, source, WIRE_F);
    wire_mv[channel] = (wire_mv[channel] * WIRE_F + hold_mv * HOLD_F) / (WIRE_F + HOLD_F);
    chosen = channel;
  } else {
    settle(channel, source, WIRE_F + HOLD_F);
  }
  hold_mv = wire_mv[channel];
  const uint8_t ignored = read_adcl(a, address, parameter);
  (void)ignored;
  int code = (int)floor(hold_mv / SUPPLY_MV * 1024);
  if (code < 0) code = 0;
  if (code > 1023) code = 1023;
  a->data[REGISTER_ADCL] = code & 0xFF;
  a->data[REGISTER_ADCL + 1] = code >> 8;
  return code & 0xFF;
}

static void on_uart(struct avr_irq_t *irq, uint32_t value, void *parameter) {
  (void)irq, (void)parameter;
  if (out_length < sizeof out) out[out_length++] = value;
}

/* The MPU-6050: its registers, as far as firmware needs them. Off the bus it forgets them, and starts when it is back. */
enum { SENSOR_ADDRESS = 0x68, REGISTER_DATA = 0x3B, DATA_BYTES = 14, REGISTER_POWER = 0x6B, POWER_ASLEEP = 0x40,
       REGISTER_RATE_RANGE = 0x1B, REGISTER_FORCE_RANGE = 0x1C };
static uint8_t sensor_register[128], power_at_start = POWER_ASLEEP, rate_range_at_start, force_range_at_start;
static uint8_t sensor_pointer;
static int sensor_is_selected, sensor_expects_pointer;
static struct avr_irq_t *twi_input;

static void start_sensor(void) {
  memset(sensor_register, 0, sizeof sensor_register);
  sensor_register[REGISTER_POWER] = power_at_start;
  sensor_register[REGISTER_RATE_RANGE] = rate_range_at_start;
  sensor_register[REGISTER_FORCE_RANGE] = force_range_at_start;
}

/* How many digits stand for one of the file: each step of a range, 2, 4, 8, 16 g or 250 .. 2000, halves them. */
static double digits(int register_of_range) {
  return 4.0 / (1 << (sensor_register[register_of_range] >> 3 & 3));
}

/* A burst holds one sample, as the sensor's shadow registers do. */
static void latch_sample(void) {
  for (int k = 0; k < DATA_BYTES / 2; k++) {
    const double scale = k == 3 ? 1.0 : digits(k < 3 ? REGISTER_FORCE_RANGE : REGISTER_RATE_RANGE);
    const int value = sensor_register[REGISTER_POWER] == POWER_ASLEEP ? 0 : (int)(scale * played(&samples, k));
    sensor_register[REGISTER_DATA + 2 * k] = value >> 8 & 0xFF;
    sensor_register[REGISTER_DATA + 2 * k + 1] = value & 0xFF;
  }
}

static void on_twi(struct avr_irq_t *irq, uint32_t value, void *parameter) {
  (void)irq, (void)parameter;
  avr_twi_msg_irq_t message = {.u.v = value};
  const uint8_t kind = message.u.twi.msg;
  if (kind & TWI_COND_STOP) sensor_is_selected = 0;
  if (sensor_is_off) {
    start_sensor();
    sensor_is_selected = 0;
    return;
  }
  if (kind & TWI_COND_START) {
    sensor_is_selected = message.u.twi.addr >> 1 == SENSOR_ADDRESS;
    sensor_expects_pointer = 1;
    if (sensor_is_selected) {
      latch_sample();
      avr_raise_irq(twi_input, avr_twi_irq_msg(TWI_COND_ACK, message.u.twi.addr, 1));
    }
  } else if (sensor_is_selected && kind & TWI_COND_WRITE) {
    avr_raise_irq(twi_input, avr_twi_irq_msg(TWI_COND_ACK, message.u.twi.addr, 1));
    if (sensor_expects_pointer) sensor_pointer = message.u.twi.data & 0x7F;
    else sensor_register[sensor_pointer++ & 0x7F] = message.u.twi.data;
    sensor_expects_pointer = 0;
  } else if (sensor_is_selected && kind & TWI_COND_READ) {
    avr_raise_irq(twi_input, avr_twi_irq_msg(TWI_COND_READ, message.u.twi.addr, sensor_register[sensor_pointer++ & 0x7F]));
  }
}

static void no_sleep(avr_t *a, avr_cycle_count_t cycles) { (void)a, (void)cycles; }

/* Undo COBS far enough to know a row's sequence number. */
static void log_frames(FILE *log, const unsigned char *bytes, size_t length, double at_s) {
  static unsigned char frame[256];
  static size_t filled;
  for (size_t k = 0; k < length; k++) {
    if (bytes[k] != 0) {
      if (filled < sizeof frame) frame[filled++] = bytes[k];
      continue;
    }
    unsigned char plain[256];
    size_t n = 0;
    for (size_t at = 0; at < filled; ) {
      unsigned code = frame[at++];
      for (unsigned j = 1; j < code && at < filled; j++) plain[n++] = frame[at++];
      if (at < filled) plain[n++] = 0;
    }
    if (n > 7 && plain[1] == 1) fprintf(log, "%u %.6f\n", plain[5] | plain[6] << 8, at_s);
    filled = 0;
  }
}

static void eeprom(const char *path, int load) {
  uint8_t bytes[EEPROM_BYTES];
  avr_eeprom_desc_t desc = {.ee = bytes, .offset = 0, .size = EEPROM_BYTES};
  FILE *file = fopen(path, load ? "rb" : "wb");
  if (!file && load) return;
  if (!file) die(path);
  if (load) {
    if (fread(bytes, 1, sizeof bytes, file) == sizeof bytes)
      avr_ioctl(avr, AVR_IOCTL_EEPROM_SET, &desc);
  } else {
    avr_ioctl(avr, AVR_IOCTL_EEPROM_GET, &desc); /* returns -1, always */
    fwrite(bytes, 1, sizeof bytes, file);
  }
  fclose(file);
}

int main(int argc, char **argv) {
  if (argc < 4) {
    fprintf(stderr, "usage: board FIRMWARE.elf LINK VOLTAGES.csv [RATE_PPM [EEPROM [LOG [SAMPLES.csv [POWER RATE_RANGE FORCE_RANGE]]]]]\n");
    return 2;
  }
  const double speed = F_CPU_HZ * (1 + (argc > 4 ? atof(argv[4]) : 0) * 1e-6);
  FILE *log = argc > 6 ? fopen(argv[6], "w") : NULL;
  voltages = read_table(argv[3]);

  int master, slave;
  char name[256];
  struct termios raw;
  if (openpty(&master, &slave, name, NULL, NULL)) die("openpty");
  tcgetattr(slave, &raw);
  cfmakeraw(&raw);
  tcsetattr(slave, TCSANOW, &raw);
  fcntl(master, F_SETFL, O_NONBLOCK);
  unlink(argv[2]);
  if (symlink(name, argv[2])) die(argv[2]);

  elf_firmware_t firmware = {0};
  if (elf_read_firmware(argv[1], &firmware)) die(argv[1]);
  avr = avr_make_mcu_by_name("atmega2560");
  avr_init(avr);
  avr->frequency = F_CPU_HZ;
  avr->sleep = no_sleep;
  avr->vcc = avr->avcc = avr->aref = SUPPLY_MV;
  avr_load_firmware(avr, &firmware);
  if (argc > 5) eeprom(argv[5], 1);
  uint32_t flags = 0;
  avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
  flags &= ~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_uart, NULL);
  read_adcl = avr->io[AVR_DATA_TO_IO(REGISTER_ADCL)].r.c;
  avr->io[AVR_DATA_TO_IO(REGISTER_ADCL)].r.c = on_adcl;

  if (argc > 7) {
    samples = read_table(argv[7]);
    if (argc > 10) {
      power_at_start = (uint8_t)atoi(argv[8]);
      rate_range_at_start = (uint8_t)atoi(argv[9]);
      force_range_at_start = (uint8_t)atoi(argv[10]);
    }
    start_sensor();
    twi_input = avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_OUTPUT), on_twi, NULL);
  }

  signal(SIGUSR1, on_plug);
  signal(SIGTERM, on_signal);
  signal(SIGINT, SIG_IGN);
  double origin_s = now_s();
  for (uint64_t slice = 1; !stop; slice++) {
    const avr_cycle_count_t until = slice * SLICE_US * F_CPU_HZ / 1000000;
    while (avr->cycle < until) {
      const int state = avr_run(avr);
      if (state == cpu_Done || state == cpu_Crashed) die("the firmware ended");
    }
    const double ahead_s = origin_s + avr->cycle / speed - now_s();
    if (ahead_s < -0.01) {
      origin_s -= ahead_s; /* a busy machine: be late from now on, as no real board hurries to make up for it */
    } else if (ahead_s > 0) {
      struct timespec pause = {(time_t)ahead_s, (long)(1e9 * (ahead_s - floor(ahead_s)))};
      nanosleep(&pause, NULL);
    }
    if (out_length) {
      /* nobody reads: the bytes are gone, as on a real line; a pty that was never opened keeps what fits */
      const double leaves_s = now_s();
      if (write(master, out, out_length) < 0 && errno != EAGAIN && errno != EIO) die("pty");
      if (log) log_frames(log, out, out_length, leaves_s);
      out_length = 0;
    }
  }
  if (argc > 5) eeprom(argv[5], 0);
  if (log) fclose(log);
  unlink(argv[2]);
  return 0;
}
