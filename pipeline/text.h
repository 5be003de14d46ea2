// Sentences with two figures in them, for verdicts and notes.
#pragma once

#include <cstdio>
#include <string>

namespace granary {

/// `format` takes two doubles, printf's way.
[[nodiscard]] inline std::string FormatText(const char* format, double a, double b) {
  char text[256];
  std::snprintf(text, sizeof text, format, a, b);
  return text;
}

}  // namespace granary
