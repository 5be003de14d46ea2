// Everything is laid out in whole pixels around the body; text is OpenCV's own stroke font, so no font file is needed.
#include "pipeline/plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace granary {
namespace {

constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr double kTextScale = 0.55, kTitleScale = 0.75;
constexpr int kTick = 6, kGap = 8, kTextHeight = 14;
constexpr int kBarWidth = 22;
constexpr int kBarArea = 130;  // bar, its numbers and its label
const cv::Scalar kInvalid(205, 205, 205), kWhite(255, 255, 255);

int TextWidth(const std::string& text, double scale) {
  int baseline = 0;
  return cv::getTextSize(text, kFont, scale, 1, &baseline).width;
}

void DrawText(cv::Mat& picture, const std::string& text, cv::Point left_base, double scale, const cv::Scalar& colour) {
  cv::putText(picture, text, left_base, kFont, scale, colour, 1, cv::LINE_AA);
}

double StepOf(const std::vector<double>& ticks) { return ticks.size() > 1 ? ticks[1] - ticks[0] : 1; }

struct PlacedTick {
  double share;  ///< 0 at the start of the axis, 1 at its end
  std::string text;
};

std::vector<PlacedTick> PlaceTicks(double at_start, double at_end, int length_px, int spacing_px) {
  const std::vector<double> values =
      RoundTicks(std::min(at_start, at_end), std::max(at_start, at_end), std::max(2, length_px / spacing_px));
  std::vector<PlacedTick> ticks;
  for (const double value : values) {
    ticks.push_back({(value - at_start) / (at_end - at_start), RoundText(value, StepOf(values))});
  }
  return ticks;
}

/// Text running upwards, centred on `centre`.
void DrawUpwardText(cv::Mat& picture, const std::string& text, cv::Point centre) {
  const cv::Size size(TextWidth(text, kTextScale) + 4, kTextHeight + 8);
  cv::Mat strip(size, CV_8UC3, kWhite);
  DrawText(strip, text, {2, kTextHeight}, kTextScale, kInk);
  cv::rotate(strip, strip, cv::ROTATE_90_COUNTERCLOCKWISE);
  const cv::Rect place(centre.x - strip.cols / 2, centre.y - strip.rows / 2, strip.cols, strip.rows);
  const cv::Rect visible = place & cv::Rect({}, picture.size());
  strip(visible - place.tl()).copyTo(picture(visible));
}

void DrawBar(cv::Mat& picture, const ColourBar& bar, const cv::Rect& body) {
  const cv::Rect place(body.br().x + 2 * kGap, body.y, kBarWidth, body.height);
  cv::Mat levels(place.size(), CV_8UC1);
  for (int row = 0; row < levels.rows; ++row) {
    levels.row(row).setTo(std::lround(255.0 * (levels.rows - 1 - row) / std::max(1, levels.rows - 1)));
  }
  cv::Mat colours;
  cv::applyColorMap(levels, colours, bar.colour_map);
  colours.copyTo(picture(place));
  cv::rectangle(picture, place, kInk, 1);
  int widest = 0;
  for (const PlacedTick& tick : PlaceTicks(bar.low, bar.high, place.height, 60)) {
    const int y = place.br().y - 1 - static_cast<int>(std::lround(tick.share * (place.height - 1)));
    cv::line(picture, {place.br().x, y}, {place.br().x + kTick, y}, kInk, 1);
    DrawText(picture, tick.text, {place.br().x + kTick + 4, y + kTextHeight / 2 - 2}, kTextScale, kInk);
    widest = std::max(widest, TextWidth(tick.text, kTextScale));
  }
  DrawUpwardText(picture, bar.label, {place.br().x + kTick + widest + 20, place.y + place.height / 2});
}

void DrawHorizontalAxis(cv::Mat& picture, const PlotAxis& axis, const cv::Rect& body) {
  for (const PlacedTick& tick : PlaceTicks(axis.at_start, axis.at_end, body.width, 100)) {
    const int x = body.x + static_cast<int>(std::lround(tick.share * (body.width - 1)));
    cv::line(picture, {x, body.br().y}, {x, body.br().y + kTick}, kInk, 1);
    DrawCentredText(picture, tick.text, {x, body.br().y + kTick + kGap + kTextHeight / 2}, kInk);
  }
  DrawCentredText(picture, axis.label,
                  {body.x + body.width / 2, body.br().y + kTick + 2 * kGap + 3 * kTextHeight / 2 + 4}, kInk);
}

void DrawVerticalAxis(cv::Mat& picture, const PlotAxis& axis, const cv::Rect& body) {
  for (const PlacedTick& tick : PlaceTicks(axis.at_start, axis.at_end, body.height, 70)) {
    const int y = body.br().y - 1 - static_cast<int>(std::lround(tick.share * (body.height - 1)));
    cv::line(picture, {body.x - kTick, y}, {body.x - 1, y}, kInk, 1);
    DrawText(picture, tick.text, {body.x - kTick - 4 - TextWidth(tick.text, kTextScale), y + kTextHeight / 2 - 2},
             kTextScale, kInk);
  }
  DrawUpwardText(picture, axis.label, {16, body.y + body.height / 2});
}

}  // namespace

double RoundStep(double rough) {
  const double power = std::pow(10, std::floor(std::log10(rough)));
  double step = 10 * power;
  for (const double factor : {5, 2, 1}) {
    if (factor * power >= rough * 0.999) step = factor * power;
  }
  return step;
}

std::string RoundText(double value, double step) {
  const int decimals = std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 9);
  if (std::abs(value) < step * 1e-6) value = 0;  // no "-0.0"
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
  return text.data();
}

std::vector<double> RoundTicks(double low, double high, int count) {
  if (!(high > low) || count < 1) return {low};
  const double step = RoundStep((high - low) / count);
  std::vector<double> ticks;
  const double slack = 1e-9 * (high - low);
  for (double n = std::ceil((low - slack) / step); n * step <= high + slack; ++n) ticks.push_back(n * step);
  return ticks;
}

std::pair<double, double> FiniteRange(const cv::Mat& values, double low, double high) {
  std::vector<float> finite;
  finite.reserve(values.total());
  for (const float value : cv::Mat_<float>(values)) {
    if (std::isfinite(value)) finite.push_back(value);
  }
  if (finite.empty()) return {0, 1};
  const auto at = [&](double share) {
    const auto nth = finite.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(finite.size() - 1));
    std::nth_element(finite.begin(), nth, finite.end());
    return static_cast<double>(*nth);
  };
  const double first = at(low), last = at(high);
  return last > first ? std::pair(first, last) : std::pair(first - 0.5, last + 0.5);
}

cv::Mat Colourise(const cv::Mat& values, const ColourBar& bar) {
  cv::Mat levels(values.size(), CV_8UC1), valid(values.size(), CV_8UC1);
  const double scale = bar.high > bar.low ? 255 / (bar.high - bar.low) : 0;
  for (int row = 0; row < values.rows; ++row) {
    for (int col = 0; col < values.cols; ++col) {
      const double value = values.at<float>(row, col);
      valid.at<std::uint8_t>(row, col) = std::isfinite(value) ? 255 : 0;
      levels.at<std::uint8_t>(row, col) =
          std::isfinite(value) ? cv::saturate_cast<std::uint8_t>((value - bar.low) * scale) : 0;
    }
  }
  cv::Mat colours, picture(values.size(), CV_8UC3, kInvalid);
  cv::applyColorMap(levels, colours, bar.colour_map);
  colours.copyTo(picture, valid);
  return picture;
}

void DrawCentredText(cv::Mat& picture, const std::string& text, cv::Point centre, const cv::Scalar& colour) {
  DrawText(picture, text, {centre.x - TextWidth(text, kTextScale) / 2, centre.y + kTextHeight / 2 - 2}, kTextScale,
           colour);
}

cv::Size TextSize(const std::string& text) { return {TextWidth(text, kTextScale), kTextHeight}; }

cv::Mat AppendLegend(const cv::Mat& picture, std::span<const LegendEntry> entries) {
  constexpr int kSquare = 14, kBetween = 26, kHeight = 34;
  int width = kBetween;
  for (const LegendEntry& entry : entries) width += kSquare + kGap + TextWidth(entry.text, kTextScale) + kBetween;
  cv::Mat out;
  const int more = std::max(0, width - picture.cols);
  cv::copyMakeBorder(picture, out, 0, kHeight, more / 2, more - more / 2, cv::BORDER_CONSTANT, kWhite);
  int x = (out.cols - width) / 2 + kBetween;
  const int y = out.rows - kHeight + 4;
  for (const LegendEntry& entry : entries) {
    const cv::Rect square(x, y, kSquare, kSquare);
    cv::rectangle(out, square, Bgr(entry.colour), cv::FILLED);
    cv::rectangle(out, square, kInk, 1);
    x += kSquare + kGap;
    DrawText(out, entry.text, {x, y + kTextHeight - 2}, kTextScale, kInk);
    x += TextWidth(entry.text, kTextScale) + kBetween;
  }
  return out;
}

cv::Mat FramePlot(const cv::Mat& body, const std::string& title, const std::optional<PlotAxis>& x,
                  const std::optional<PlotAxis>& y, const std::optional<ColourBar>& bar) {
  const int top = title.empty() ? 16 : 52;
  const int left = y ? 90 : 20;
  const int bottom = x ? 68 : 20;
  const int right = bar ? kBarArea + 2 * kGap : 28;
  const int title_width = TextWidth(title, kTitleScale) + left + 20;  // a long title widens the picture
  cv::Mat picture(body.rows + top + bottom, std::max(body.cols + left + right, title_width), CV_8UC3, kWhite);
  const cv::Rect place(left, top, body.cols, body.rows);
  body.copyTo(picture(place));
  cv::rectangle(picture, {place.x - 1, place.y - 1, place.width + 2, place.height + 2}, kInk, 1);
  DrawText(picture, title, {left, 34}, kTitleScale, kInk);
  if (x) DrawHorizontalAxis(picture, *x, place);
  if (y) DrawVerticalAxis(picture, *y, place);
  if (bar) DrawBar(picture, *bar, place);
  return picture;
}

}  // namespace granary
