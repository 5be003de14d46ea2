// What a camera saw: each picture is a body made here, pixel by pixel, in a frame from plot.h. Those of the bin have
// files of their own.
#include "pipeline/pictures.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/plot.h"

namespace granary {
namespace {

constexpr int kLargestBody = 1280;  // pictures from larger cameras are shrunk to this
constexpr int kLineEvery = 64;      // rows between the lines of a rectified pair
const cv::Scalar kOutside(255, 255, 255);

/// 8-bit BGR, stretched so that `white` is full.
cv::Mat GreyAsBgr(const cv::Mat& grey, double white) {
  cv::Mat stretched, bgr;
  grey.convertTo(stretched, CV_8U, white > 0 ? 255 / white : 0);
  cv::cvtColor(stretched, bgr, cv::COLOR_GRAY2BGR);
  return bgr;
}

/// The level that 99.9 % of the pixels do not exceed.
double White(const cv::Mat& grey) {
  cv::Mat values;
  grey.convertTo(values, CV_32F);
  return std::max(FiniteRange(values, 0, 0.999).second, 1e-6);
}

void CheckGrey(const cv::Mat& image, const char* name) {
  if (image.empty() || image.channels() != 1) {
    throw std::invalid_argument(std::string(name) + ": a picture of one channel is wanted");
  }
}

/// Shrinks what is larger than a screen; enlarges small pictures by a whole number.
cv::Mat FitBody(const cv::Mat& body, int interpolation_down) {
  const int longer = std::max(body.cols, body.rows);
  cv::Mat fitted = body;
  if (longer > kLargestBody) {
    const double scale = double(kLargestBody) / longer;
    cv::resize(body, fitted, {}, scale, scale, interpolation_down);
  } else if (const int times = 640 / std::max(1, longer); times > 1) {
    cv::resize(body, fitted, {}, times, times, cv::INTER_NEAREST);
  }
  return fitted;
}

PlotAxis Columns(const cv::Mat& image) { return {0, static_cast<double>(image.cols), "column [px]"}; }
PlotAxis Rows(const cv::Mat& image) { return {static_cast<double>(image.rows), 0, "row [px]"}; }

}  // namespace

cv::Mat DisparityPicture(const cv::Mat& disparity_px, const std::string& title) {
  if (disparity_px.type() != CV_32FC1 || disparity_px.empty()) {
    throw std::invalid_argument("disparity: one float channel is wanted");
  }
  const auto [low, high] = FiniteRange(disparity_px, 0.005, 0.995);
  const ColourBar bar{low, high, "disparity [px]", cv::COLORMAP_TURBO};
  // Nearest, so that no colour is mixed of a surface and what lies behind it.
  const cv::Mat body = FitBody(Colourise(disparity_px, bar), cv::INTER_NEAREST);
  return FramePlot(body, title, Columns(disparity_px), Rows(disparity_px), bar);
}

cv::Mat RectifiedPicture(const cv::Mat& left, const cv::Mat& right) {
  CheckGrey(left, "left");
  CheckGrey(right, "right");
  if (left.size() != right.size()) throw std::invalid_argument("rectified pair: both must have one size");
  const double white = std::max(White(left), White(right));
  constexpr int kSeam = 8;
  cv::Mat body(left.rows, 2 * left.cols + kSeam, CV_8UC3, kOutside);
  GreyAsBgr(left, white).copyTo(body.colRange(0, left.cols));
  GreyAsBgr(right, white).copyTo(body.colRange(left.cols + kSeam, body.cols));
  for (int row = kLineEvery; row < body.rows; row += kLineEvery) {
    const bool even = row / kLineEvery % 2 == 0;  // two colours, so that the eye does not slip to the next line
    cv::line(body, {0, row}, {body.cols - 1, row}, even ? cv::Scalar(80, 220, 80) : cv::Scalar(60, 180, 255), 1);
  }
  return FramePlot(body, "Rectified pair: left | right, a line every 64 rows", std::nullopt, Rows(left), std::nullopt);
}

cv::Mat MaskPicture(const cv::Mat& left, const cv::Mat& grain_mask, const std::string& title) {
  CheckGrey(left, "left");
  if (grain_mask.type() != CV_8UC1 || grain_mask.size() != left.size()) {
    throw std::invalid_argument("grain mask: CV_8UC1 of the picture's size is wanted");
  }
  cv::Mat picture = GreyAsBgr(left, White(left));
  for (int row = 0; row < picture.rows; ++row) {
    for (int col = 0; col < picture.cols; ++col) {
      if (grain_mask.at<std::uint8_t>(row, col) == 0) continue;
      auto& pixel = picture.at<cv::Vec3b>(row, col);
      const int grey = pixel[0];
      // Amber over the picture's own light, so that the speckle stays visible.
      pixel = {static_cast<std::uint8_t>(grey * 3 / 10), static_cast<std::uint8_t>(60 + grey * 6 / 10),
               static_cast<std::uint8_t>(105 + grey * 15 / 100 * 3)};
    }
  }
  return FramePlot(FitBody(picture, cv::INTER_AREA), title, Columns(left), Rows(left), std::nullopt);
}

}  // namespace granary
