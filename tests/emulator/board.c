/* A Mega 2560 that runs real firmware in simavr, as a serial port: its UART is a pty, its analog inputs follow a file.
 *
 *   board FIRMWARE.elf LINK VOLTAGES.csv [RATE_PPM [EEPROM [LOG]]]
 *
 * LINK becomes a symbolic link to the pty. VOLTAGES.csv holds t_s and one column of millivolts a channel, no header;
 * it is played by the board's own clock, again from the start at its end. RATE_PPM is how much too fast that clock
 * runs. EEPROM keeps the boot counter from one start to the next. LOG gets a line "sequence monotonic_s" whenever a
 * frame's last byte has left.
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
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

enum { CHANNELS = 16, EEPROM_BYTES = 4096, SLICE_US = 500, REGISTER_ADCL = 0x78, REGISTER_ADMUX = 0x7C,
       REGISTER_ADCSRB = 0x7B };
static const double F_CPU_HZ = 16e6, HOLD_F = 14e-12, WIRE_F = 60e-12, SOURCE_OHM = 2.9e6, SUPPLY_MV = 5000.0;

static double *table;
static int rows, columns;
static avr_t *avr;
static double hold_mv, wire_mv[CHANNELS];
static avr_cycle_count_t settled_cycle[CHANNELS];
static int chosen = -1;
static avr_io_read_t read_adcl;
static unsigned char out[4096];
static size_t out_length;
static volatile sig_atomic_t stop;

static void on_signal(int number) { (void)number; stop = 1; }

static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec + 1e-9 * t.tv_nsec;
}

static void die(const char *what) {
  fprintf(stderr, "board: %s: %s\n", what, strerror(errno));
  exit(1);
}

static void read_table(const char *path) {
  FILE *file = fopen(path, "r");
  char line[1024];
  if (!file) die(path);
  while (fgets(line, sizeof line, file)) {
    columns = 0;
    for (char *cell = strtok(line, ","); cell; cell = strtok(NULL, ",")) columns++;
    rows++;
  }
  table = calloc((size_t)rows * columns, sizeof *table);
  rewind(file);
  for (int k = 0; fgets(line, sizeof line, file); k++) {
    int c = 0;
    for (char *cell = strtok(line, ","); cell && c < columns; cell = strtok(NULL, ",")) table[k * columns + c++] = atof(cell);
  }
  fclose(file);
}

static double source_mv(int channel) {
  const double first = table[0], last = table[(rows - 1) * columns];
  const double t = first + fmod(avr->cycle / F_CPU_HZ, last - first + 1e-9);
  int low = 0, high = rows - 1;
  while (high - low > 1) {
    int middle = (low + high) / 2;
    if (table[middle * columns] <= t) low = middle; else high = middle;
  }
  return channel + 1 < columns ? table[low * columns + channel + 1] : 0.0;
}

static void settle(int channel, double source, double capacitance_f) {
  const double since_s = (avr->cycle - settled_cycle[channel]) / F_CPU_HZ;
  wire_mv[channel] += (source - wire_mv[channel]) * (1 - exp(-since_s / (SOURCE_OHM * capacitance_f)));
  settled_cycle[channel] = avr->cycle;
}

/* Called when firmware reads ADCL, once a conversion: simavr 1.6 knows eight of the sixteen channels, and no charge. */
static uint8_t on_adcl(avr_t *a, avr_io_addr_t address, void *parameter) {
  const int channel = (a->data[REGISTER_ADMUX] & 7) | (a->data[REGISTER_ADCSRB] & 8);
  const double source = source_mv(channel);
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
    fprintf(stderr, "usage: board FIRMWARE.elf LINK VOLTAGES.csv [RATE_PPM [EEPROM [LOG]]]\n");
    return 2;
  }
  const double speed = F_CPU_HZ * (1 + (argc > 4 ? atof(argv[4]) : 0) * 1e-6);
  FILE *log = argc > 6 ? fopen(argv[6], "w") : NULL;
  read_table(argv[3]);

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
