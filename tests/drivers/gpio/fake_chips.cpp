#include "tests/drivers/gpio/fake_chips.h"

#include <cerrno>
#include <filesystem>

namespace granary {

FakeKernel& Kernel() {
  static FakeKernel kernel;
  return kernel;
}

FakeChip* OpenFakeChip(const std::string& path) {
  const auto found = Kernel().chips.find(std::filesystem::path(path).filename().string());
  errno = found == Kernel().chips.end() ? ENOENT : found->second.open_error;
  return errno == 0 ? &found->second : nullptr;
}

int RequestFakeLine(FakeChip& chip, unsigned offset, const std::string& consumer, bool active_low, int value) {
  FakeChipLine& line = chip.lines.at(offset);
  if (line.used) {
    errno = EBUSY;
    return -1;
  }
  line.used = true;
  line.consumer = consumer;
  line.active_low = active_low;
  line.levels.push_back(value ^ static_cast<int>(active_low));
  return 0;
}

int SetFakeLine(FakeChip& chip, unsigned offset, int value) {
  if (Kernel().set_error != 0) {
    errno = Kernel().set_error;
    return -1;
  }
  FakeChipLine& line = chip.lines.at(offset);
  line.levels.push_back(value ^ static_cast<int>(line.active_low));
  return 0;
}

void ReleaseFakeLine(FakeChip& chip, unsigned offset) {
  chip.lines.at(offset).used = false;
  chip.lines.at(offset).consumer.clear();
}

}  // namespace granary
