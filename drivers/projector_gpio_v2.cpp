// The chip and its lines through libgpiod 2. A request stands by itself, so the chip is closed again.
#include <gpiod.h>

#include <cerrno>
#include <memory>
#include <string>
#include <system_error>
#include <utility>

#include "drivers/errors.h"
#include "drivers/gpio_chip.h"
#include "drivers/gpio_line.h"

namespace granary {
namespace {

/// Frees a handle by the library's own function.
template <auto Free>
struct Freed {
  template <typename Handle>
  void operator()(Handle* handle) const {
    Free(handle);
  }
};
using ChipHandle = std::unique_ptr<gpiod_chip, Freed<gpiod_chip_close>>;
using ChipInfoHandle = std::unique_ptr<gpiod_chip_info, Freed<gpiod_chip_info_free>>;
using LineInfoHandle = std::unique_ptr<gpiod_line_info, Freed<gpiod_line_info_free>>;
using SettingsHandle = std::unique_ptr<gpiod_line_settings, Freed<gpiod_line_settings_free>>;
using LineConfigHandle = std::unique_ptr<gpiod_line_config, Freed<gpiod_line_config_free>>;
using RequestConfigHandle = std::unique_ptr<gpiod_request_config, Freed<gpiod_request_config_free>>;
using RequestHandle = std::unique_ptr<gpiod_line_request, Freed<gpiod_line_request_release>>;

std::string Text(const char* text) { return text == nullptr ? "" : text; }

class LineV2 final : public OutputLine {
 public:
  LineV2(RequestHandle request, unsigned offset, std::string device)
      : request_(std::move(request)), offset_(offset), device_(std::move(device)) {}
  ~LineV2() override { EndLine(*this, device_); }
  LineV2(const LineV2&) = delete;
  LineV2& operator=(const LineV2&) = delete;

  void Set(bool active) override {
    const auto value = active ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE;
    if (gpiod_line_request_set_value(request_.get(), offset_, value) == 0) return;
    throw DeviceError(Reason::kProjectorFault, device_, active ? "set active" : "set inactive",
                      std::generic_category().message(errno));
  }

 private:
  RequestHandle request_;
  unsigned offset_;
  std::string device_;
};

class ChipV2 final : public GpioChip {
 public:
  explicit ChipV2(const std::string& path) : chip_(gpiod_chip_open(path.c_str())) {
    if (!chip_) ThrowGpioError("gpiod_chip_open");
    info_.reset(gpiod_chip_get_info(chip_.get()));
    if (!info_) ThrowGpioError("gpiod_chip_get_info");
  }
  [[nodiscard]] std::string Label() const override { return Text(gpiod_chip_info_get_label(info_.get())); }
  [[nodiscard]] unsigned LineCount() const override {
    return static_cast<unsigned>(gpiod_chip_info_get_num_lines(info_.get()));
  }
  [[nodiscard]] GpioLineInfo Info(unsigned offset) const override {
    const LineInfoHandle line(gpiod_chip_get_line_info(chip_.get(), offset));
    if (!line) ThrowGpioError("gpiod_chip_get_line_info");
    return {Text(gpiod_line_info_get_name(line.get())), Text(gpiod_line_info_get_consumer(line.get())),
            gpiod_line_info_is_used(line.get())};
  }
  [[nodiscard]] std::unique_ptr<OutputLine> Request(unsigned offset, const LineRequest& request,
                                                    const std::string& device) override {
    const SettingsHandle settings(gpiod_line_settings_new());
    if (!settings) ThrowGpioError("gpiod_line_settings_new");
    if (gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_OUTPUT) != 0) {
      ThrowGpioError("gpiod_line_settings_set_direction");
    }
    if (gpiod_line_settings_set_output_value(settings.get(), GPIOD_LINE_VALUE_INACTIVE) != 0) {
      ThrowGpioError("gpiod_line_settings_set_output_value");
    }
    gpiod_line_settings_set_active_low(settings.get(), request.active_low);

    const LineConfigHandle lines(gpiod_line_config_new());
    if (!lines) ThrowGpioError("gpiod_line_config_new");
    if (gpiod_line_config_add_line_settings(lines.get(), &offset, 1, settings.get()) != 0) {
      ThrowGpioError("gpiod_line_config_add_line_settings");
    }
    const RequestConfigHandle config(gpiod_request_config_new());
    if (!config) ThrowGpioError("gpiod_request_config_new");
    gpiod_request_config_set_consumer(config.get(), request.consumer.c_str());

    RequestHandle requested(gpiod_chip_request_lines(chip_.get(), config.get(), lines.get()));
    if (!requested) ThrowGpioError("gpiod_chip_request_lines");
    return std::make_unique<LineV2>(std::move(requested), offset, device);
  }

 private:
  ChipHandle chip_;
  ChipInfoHandle info_;
};

}  // namespace

std::unique_ptr<GpioChip> OpenGpioChip(const std::string& path) { return std::make_unique<ChipV2>(path); }

}  // namespace granary
