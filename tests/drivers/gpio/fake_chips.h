// The chips that the tests' libgpiod shows: what a kernel would keep of them, and how many handles are out.
#pragma once

#include <map>
#include <string>
#include <vector>

namespace granary {

struct FakeChipLine {
  std::string name;
  std::string consumer;  ///< of whoever holds it
  bool used = false;
  bool active_low = false;  ///< as requested
  std::vector<int> levels;  ///< that were driven, physical, the first one with the request
};

struct FakeChip {
  std::string label;
  std::vector<FakeChipLine> lines;
  int open_error = 0;  ///< an errno
};

/// One for the process, as the kernel is.
struct FakeKernel {
  std::map<std::string, FakeChip> chips;  ///< by the file's name, "gpiochip0"
  int set_error = 0;                      ///< errno of every attempt to set a line
  int open_handles = 0;                   ///< chips, lines, and whatever else the library hands out
};

[[nodiscard]] FakeKernel& Kernel();

/// What both versions of the library do; -1 sets errno.
[[nodiscard]] FakeChip* OpenFakeChip(const std::string& path);
[[nodiscard]] int RequestFakeLine(FakeChip& chip, unsigned offset, const std::string& consumer, bool active_low,
                                  int value);
[[nodiscard]] int SetFakeLine(FakeChip& chip, unsigned offset, int value);
void ReleaseFakeLine(FakeChip& chip, unsigned offset);

}  // namespace granary
