// The calls of libgpiod 2 that the driver makes, over the tests' own chips. As the program defines them, the library's
// are not used.
#include <gpiod.h>

#include <cerrno>
#include <string>

#include "tests/drivers/gpio/fake_chips.h"

using granary::FakeChip;
using granary::FakeChipLine;
using granary::Kernel;

struct gpiod_chip {
  FakeChip* chip;
};
struct gpiod_chip_info {
  FakeChip* chip;
};
struct gpiod_line_info {
  FakeChipLine line;
};
struct gpiod_line_settings {
  gpiod_line_direction direction = GPIOD_LINE_DIRECTION_AS_IS;
  gpiod_line_value value = GPIOD_LINE_VALUE_INACTIVE;
  bool active_low = false;
};
struct gpiod_line_config {
  unsigned offset = 0;
  gpiod_line_settings settings;
  bool set = false;
};
struct gpiod_request_config {
  std::string consumer;
};
struct gpiod_line_request {
  FakeChip* chip;
  unsigned offset;
};

namespace {

template <typename Handle>
Handle* HandOut(Handle handle) {
  ++Kernel().open_handles;
  return new Handle(handle);
}

template <typename Handle>
void TakeBack(Handle* handle) {
  if (handle != nullptr) --Kernel().open_handles;
  delete handle;
}

}  // namespace

extern "C" {

gpiod_chip* gpiod_chip_open(const char* path) {
  FakeChip* chip = granary::OpenFakeChip(path);
  return chip == nullptr ? nullptr : HandOut(gpiod_chip{chip});
}
void gpiod_chip_close(gpiod_chip* chip) { TakeBack(chip); }

gpiod_chip_info* gpiod_chip_get_info(gpiod_chip* chip) { return HandOut(gpiod_chip_info{chip->chip}); }
void gpiod_chip_info_free(gpiod_chip_info* info) { TakeBack(info); }
const char* gpiod_chip_info_get_label(gpiod_chip_info* info) { return info->chip->label.c_str(); }
size_t gpiod_chip_info_get_num_lines(gpiod_chip_info* info) { return info->chip->lines.size(); }

gpiod_line_info* gpiod_chip_get_line_info(gpiod_chip* chip, unsigned int offset) {
  if (offset >= chip->chip->lines.size()) {
    errno = EINVAL;
    return nullptr;
  }
  return HandOut(gpiod_line_info{chip->chip->lines[offset]});
}
void gpiod_line_info_free(gpiod_line_info* info) { TakeBack(info); }
const char* gpiod_line_info_get_name(gpiod_line_info* info) {
  return info->line.name.empty() ? nullptr : info->line.name.c_str();
}
const char* gpiod_line_info_get_consumer(gpiod_line_info* info) {
  return info->line.consumer.empty() ? nullptr : info->line.consumer.c_str();
}
bool gpiod_line_info_is_used(gpiod_line_info* info) { return info->line.used; }

gpiod_line_settings* gpiod_line_settings_new(void) { return HandOut(gpiod_line_settings{}); }
void gpiod_line_settings_free(gpiod_line_settings* settings) { TakeBack(settings); }
int gpiod_line_settings_set_direction(gpiod_line_settings* settings, gpiod_line_direction direction) {
  settings->direction = direction;
  return 0;
}
int gpiod_line_settings_set_output_value(gpiod_line_settings* settings, gpiod_line_value value) {
  settings->value = value;
  return 0;
}
void gpiod_line_settings_set_active_low(gpiod_line_settings* settings, bool active_low) {
  settings->active_low = active_low;
}

gpiod_line_config* gpiod_line_config_new(void) { return HandOut(gpiod_line_config{}); }
void gpiod_line_config_free(gpiod_line_config* config) { TakeBack(config); }
int gpiod_line_config_add_line_settings(gpiod_line_config* config, const unsigned int* offsets, size_t num_offsets,
                                        gpiod_line_settings* settings) {
  if (num_offsets != 1 || config->set) {
    errno = E2BIG;
    return -1;
  }
  config->offset = offsets[0];
  config->settings = *settings;
  config->set = true;
  return 0;
}

gpiod_request_config* gpiod_request_config_new(void) { return HandOut(gpiod_request_config{}); }
void gpiod_request_config_free(gpiod_request_config* config) { TakeBack(config); }
void gpiod_request_config_set_consumer(gpiod_request_config* config, const char* consumer) {
  config->consumer = consumer;
}

gpiod_line_request* gpiod_chip_request_lines(gpiod_chip* chip, gpiod_request_config* req_cfg,
                                             gpiod_line_config* line_cfg) {
  // A line that is not asked for as an output could not be set.
  if (!line_cfg->set || line_cfg->settings.direction != GPIOD_LINE_DIRECTION_OUTPUT) {
    errno = EINVAL;
    return nullptr;
  }
  if (granary::RequestFakeLine(*chip->chip, line_cfg->offset, req_cfg->consumer, line_cfg->settings.active_low,
                               line_cfg->settings.value) != 0) {
    return nullptr;
  }
  return HandOut(gpiod_line_request{chip->chip, line_cfg->offset});
}
void gpiod_line_request_release(gpiod_line_request* request) {
  granary::ReleaseFakeLine(*request->chip, request->offset);
  TakeBack(request);
}
int gpiod_line_request_set_value(gpiod_line_request* request, unsigned int offset, gpiod_line_value value) {
  if (offset != request->offset) {
    errno = EINVAL;
    return -1;
  }
  return granary::SetFakeLine(*request->chip, offset, value);
}

}  // extern "C"
