// The chip and its lines through libgpiod 1.6. A line lives in its chip, so it keeps the chip open.
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

using ChipHandle = std::shared_ptr<gpiod_chip>;

std::string Text(const char* text) { return text == nullptr ? "" : text; }

class LineV1 final : public OutputLine {
 public:
  /// @param line requested already
  LineV1(ChipHandle chip, gpiod_line* line, std::string device)
      : chip_(std::move(chip)), line_(line), device_(std::move(device)) {}
  ~LineV1() override {
    EndLine(*this, device_);
    gpiod_line_release(line_);
  }
  LineV1(const LineV1&) = delete;
  LineV1& operator=(const LineV1&) = delete;

  void Set(bool active) override {
    if (gpiod_line_set_value(line_, active ? 1 : 0) == 0) return;
    throw DeviceError(Reason::kProjectorFault, device_, active ? "set active" : "set inactive",
                      std::generic_category().message(errno));
  }

 private:
  ChipHandle chip_;
  gpiod_line* line_;
  std::string device_;
};

class ChipV1 final : public GpioChip {
 public:
  explicit ChipV1(const std::string& path) : chip_(gpiod_chip_open(path.c_str()), Close) {
    if (!chip_) ThrowGpioError("gpiod_chip_open");
  }
  [[nodiscard]] std::string Label() const override { return Text(gpiod_chip_label(chip_.get())); }
  [[nodiscard]] unsigned LineCount() const override { return gpiod_chip_num_lines(chip_.get()); }
  [[nodiscard]] GpioLineInfo Info(unsigned offset) const override {
    gpiod_line* line = Line(offset);
    // The library reads it once and keeps it; a line that was free then may be busy now.
    if (gpiod_line_update(line) != 0) ThrowGpioError("gpiod_line_update");
    return {Text(gpiod_line_name(line)), Text(gpiod_line_consumer(line)), gpiod_line_is_used(line)};
  }
  [[nodiscard]] std::unique_ptr<OutputLine> Request(unsigned offset, const LineRequest& request,
                                                    const std::string& device) override {
    gpiod_line* line = Line(offset);
    const int flags = request.active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0;
    if (gpiod_line_request_output_flags(line, request.consumer.c_str(), flags, 0) != 0) {
      ThrowGpioError("gpiod_line_request_output_flags");
    }
    return std::make_unique<LineV1>(chip_, line, device);
  }

 private:
  static void Close(gpiod_chip* chip) {
    if (chip != nullptr) gpiod_chip_close(chip);
  }
  [[nodiscard]] gpiod_line* Line(unsigned offset) const {
    gpiod_line* line = gpiod_chip_get_line(chip_.get(), offset);
    if (line == nullptr) ThrowGpioError("gpiod_chip_get_line");
    return line;
  }

  ChipHandle chip_;
};

}  // namespace

std::unique_ptr<GpioChip> OpenGpioChip(const std::string& path) { return std::make_unique<ChipV1>(path); }

}  // namespace granary
