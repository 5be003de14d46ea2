// The calls of libgpiod 1.6 that the driver makes, over the tests' own chips. As the program defines them, the
// library's are not used.
#include <gpiod.h>

#include <cerrno>
#include <deque>

#include "tests/drivers/gpio/fake_chips.h"

using granary::FakeChip;
using granary::FakeChipLine;
using granary::Kernel;

struct gpiod_line {
  FakeChip* chip;
  unsigned offset;
  FakeChipLine seen;  ///< as the library last read it
};

struct gpiod_chip {
  FakeChip* chip;
  std::deque<gpiod_line> lines;
};

extern "C" {

gpiod_chip* gpiod_chip_open(const char* path) {
  FakeChip* chip = granary::OpenFakeChip(path);
  if (chip == nullptr) return nullptr;
  ++Kernel().open_handles;
  return new gpiod_chip{chip, {}};
}

void gpiod_chip_close(gpiod_chip* chip) {
  --Kernel().open_handles;
  delete chip;
}

const char* gpiod_chip_label(gpiod_chip* chip) { return chip->chip->label.c_str(); }

unsigned int gpiod_chip_num_lines(gpiod_chip* chip) { return static_cast<unsigned>(chip->chip->lines.size()); }

gpiod_line* gpiod_chip_get_line(gpiod_chip* chip, unsigned int offset) {
  if (offset >= chip->chip->lines.size()) {
    errno = EINVAL;
    return nullptr;
  }
  return &chip->lines.emplace_back(gpiod_line{chip->chip, offset, chip->chip->lines[offset]});
}

int gpiod_line_update(gpiod_line* line) {
  line->seen = line->chip->lines.at(line->offset);
  return 0;
}

const char* gpiod_line_name(gpiod_line* line) { return line->seen.name.empty() ? nullptr : line->seen.name.c_str(); }

const char* gpiod_line_consumer(gpiod_line* line) {
  return line->seen.consumer.empty() ? nullptr : line->seen.consumer.c_str();
}

bool gpiod_line_is_used(gpiod_line* line) { return line->seen.used; }

int gpiod_line_request_output_flags(gpiod_line* line, const char* consumer, int flags, int default_val) {
  const bool active_low = (flags & static_cast<int>(GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW)) != 0;
  if (granary::RequestFakeLine(*line->chip, line->offset, consumer, active_low, default_val) != 0) return -1;
  ++Kernel().open_handles;
  return 0;
}

int gpiod_line_set_value(gpiod_line* line, int value) { return granary::SetFakeLine(*line->chip, line->offset, value); }

void gpiod_line_release(gpiod_line* line) {
  --Kernel().open_handles;
  granary::ReleaseFakeLine(*line->chip, line->offset);
}

}  // extern "C"
