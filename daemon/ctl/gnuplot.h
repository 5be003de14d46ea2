// Plots by the program gnuplot, which is run and never linked.
#pragma once

#include <filesystem>
#include <string>

namespace granary {

/// Size of a plot, pixels.
struct PlotSize {
  int width_px = 1000, height_px = 640;
};

/// Runs gnuplot on `script` and leaves the picture in `png`, whole or not at all. Terminal and output are set before
/// the script begins; it draws one page. No shell and no start file of the user takes part.
/// @throws std::runtime_error naming the package when gnuplot is not installed, with gnuplot's own words when it fails
///   or draws nothing, and naming the file when the picture cannot be written
void DrawPlot(const std::string& script, const std::filesystem::path& png, PlotSize size = {});

/// `text` as a gnuplot string in single quotes, where nothing is special but the quote itself.
[[nodiscard]] std::string GnuplotQuoted(const std::string& text);

}  // namespace granary
