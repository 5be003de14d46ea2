// Finds chip and line by the name the integrator gave, and says in his words what keeps them from being used.
#include "drivers/gpio_line.h"

#include <grp.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <exception>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "drivers/errors.h"
#include "drivers/gpio_chip.h"

namespace granary {

void ThrowGpioError(const char* call) { throw std::system_error(errno, std::generic_category(), call); }

void EndLine(OutputLine& line, const std::string& device) noexcept {
  try {
    line.Set(false);
  } catch (const std::exception& error) {
    spdlog::critical("{}: released without being switched off: {}", device, error.what());
  }
}

namespace {

namespace fs = std::filesystem;

constexpr char kPrefix[] = "gpiochip";

struct FoundChip {
  fs::path path;
  std::string label;
  unsigned lines = 0;
  std::error_code error;  ///< why it could not be opened
};

std::vector<FoundChip> ChipsIn(const fs::path& devices) {
  std::vector<FoundChip> found;
  std::error_code unreadable;
  for (const auto& entry : fs::directory_iterator(devices, unreadable)) {
    if (entry.path().filename().string().rfind(kPrefix, 0) != 0) continue;
    FoundChip chip;
    chip.path = entry.path();
    try {
      const auto open = OpenGpioChip(chip.path);
      chip.label = open->Label();
      chip.lines = open->LineCount();
    } catch (const std::system_error& error) {
      chip.error = error.code();
    }
    found.push_back(std::move(chip));
  }
  std::sort(found.begin(), found.end(), [](const FoundChip& a, const FoundChip& b) { return a.path < b.path; });
  return found;
}

std::string Listed(const std::vector<FoundChip>& chips) {
  if (chips.empty()) return "there is none at all; is the chip's kernel driver loaded?";
  std::string text = "there are";
  for (const FoundChip& chip : chips) {
    text += (&chip == &chips.front() ? " " : ", ") + chip.path.string();
    text += chip.error ? " (" + chip.error.message() + ")"
                       : " [" + chip.label + "] of " + std::to_string(chip.lines) + " lines";
  }
  return text;
}

std::string GroupOf(const fs::path& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) return {};
  std::array<char, 4096> buffer{};
  group entry{};
  group* found = nullptr;
  if (::getgrgid_r(status.st_gid, &entry, buffer.data(), buffer.size(), &found) != 0 || found == nullptr) {
    return "group " + std::to_string(status.st_gid);
  }
  return std::string("group ") + entry.gr_name;
}

bool IsPermission(const std::error_code& error) {
  return error == std::errc::permission_denied || error == std::errc::operation_not_permitted;
}

std::string PermissionHint(const fs::path& path) {
  return "; the file belongs to " + GroupOf(path) +
         ": the daemon's user must be in it (SupplementaryGroups= in the unit), and a udev rule must let that group "
         "read and write; docs/wiring.md shows both";
}

/// Opens one line; holds what its errors name.
class LineOpening {
 public:
  LineOpening(const LineRequest& request, const fs::path& devices)
      : request_(request),
        devices_(devices),
        device_(request.chip + " line " + (request.name.empty() ? std::to_string(request.offset) : request.name)) {}

  std::unique_ptr<OutputLine> Open() const {
    const fs::path path = ChipPath();
    try {
      const auto chip = OpenGpioChip(path);
      const unsigned offset = Offset(*chip);
      try {
        return chip->Request(offset, request_, device_);
      } catch (const std::system_error& error) {
        if (error.code() != std::errc::device_or_resource_busy) throw;
        const GpioLineInfo info = chip->Info(offset);
        Fail("request",
             "the line is busy, held by " +
                 (info.consumer.empty() ? "the kernel or a program without a name" : "\"" + info.consumer + "\"") +
                 "; gpioinfo lists who holds what");
      }
    } catch (const std::system_error& error) {
      if (error.code() == std::errc::no_such_file_or_directory) {
        Fail("open the chip", "there is no such chip: " + Listed(ChipsIn(devices_)));
      }
      Fail("open", error.what() + (IsPermission(error.code()) ? PermissionHint(path) : std::string()));
    }
  }

 private:
  [[noreturn]] void Fail(const std::string& operation, const std::string& words) const {
    throw DeviceError(Reason::kProjectorFault, device_, operation, words);
  }

  fs::path ChipPath() const {
    if (request_.chip.find('/') != std::string::npos) return request_.chip;
    const bool is_file_name = request_.chip.rfind(kPrefix, 0) == 0 &&
                              request_.chip.find_first_not_of("0123456789", sizeof kPrefix - 1) == std::string::npos;
    if (is_file_name && fs::exists(devices_ / request_.chip)) return devices_ / request_.chip;

    const auto chips = ChipsIn(devices_);
    const FoundChip* found = nullptr;
    for (const FoundChip& chip : chips) {
      if (chip.error || chip.label != request_.chip) continue;
      if (found) {
        Fail("find the chip",
             "two chips have this label, name one by its file: " + found->path.string() + ", " + chip.path.string());
      }
      found = &chip;
    }
    if (found) return found->path;
    const auto closed =
        std::find_if(chips.begin(), chips.end(), [](const FoundChip& chip) { return IsPermission(chip.error); });
    Fail("find the chip", "there is no chip of this name or label: " + Listed(chips) +
                              (closed == chips.end() ? std::string() : PermissionHint(closed->path)));
  }

  unsigned Offset(const GpioChip& chip) const {
    const unsigned count = chip.LineCount();
    if (request_.name.empty()) {
      if (request_.offset >= 0 && static_cast<unsigned>(request_.offset) < count) {
        return static_cast<unsigned>(request_.offset);
      }
      Fail("find the line", "the chip has " + std::to_string(count) + " lines, allowed is 0 to " +
                                std::to_string(count == 0 ? 0 : count - 1));
    }
    std::optional<unsigned> found;
    for (unsigned offset = 0; offset < count; ++offset) {
      if (chip.Info(offset).name != request_.name) continue;
      if (found) {
        Fail("find the line", "two lines of the chip have this name, give the offset of one: " +
                                  std::to_string(*found) + ", " + std::to_string(offset));
      }
      found = offset;
    }
    if (!found) Fail("find the line", "the chip has no line of this name; gpioinfo lists their names");
    return *found;
  }

  const LineRequest& request_;
  const fs::path& devices_;
  std::string device_;
};

}  // namespace

std::unique_ptr<OutputLine> OpenOutputLine(const LineRequest& request, const std::filesystem::path& devices) {
  return LineOpening(request, devices).Open();
}

}  // namespace granary
