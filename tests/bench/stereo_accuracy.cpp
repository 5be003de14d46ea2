// How right the disparities are: rendered speckle with the truth of every pixel, then the photographs that have a
// reference; ours and OpenCV's MODE_HH on the same pairs.
// Usage: stereo_accuracy [--csv] [SAMPLES]
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "pipeline/cloud_files.h"
#include "pipeline/stereo/match.h"
#include "tests/bench/stereo_pairs.h"
#include "tests/pipeline/natural_pictures.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

bool csv = false;

/// Departures from the truth where `mask` is set; percentages of those pixels, or of the valid ones.
struct Error {
  double bias_px = 0, rms_px = 0;  ///< of errors below 1 px
  double locking_px = 0;           ///< peak to peak of the mean error over 20 classes of the true fraction
  double stated_ratio = 0;         ///< rms of the error over the rms of the stated deviation
  double invalid = 0, bad_1 = 0, bad_2 = 0;
  double whole_rms_px = 0;  ///< of all valid pixels, mismatches too
};

Error Compare(const cv::Mat& disparity, const cv::Mat& deviation, const cv::Mat& truth, const cv::Mat& mask) {
  constexpr int kClasses = 20;
  constexpr double kLeastPerClass = 100;
  double seen = 0, valid = 0, bad_1 = 0, bad_2 = 0, n = 0, sum = 0, squares = 0, stated = 0, all_squares = 0;
  std::vector<double> class_sum(kClasses, 0), class_count(kClasses, 0);
  for (int y = 0; y < truth.rows; ++y) {
    for (int x = 0; x < truth.cols; ++x) {
      const float expected = truth.at<float>(y, x);
      if (mask.at<std::uint8_t>(y, x) == 0 || !std::isfinite(expected)) continue;
      ++seen;
      const double error = disparity.at<float>(y, x) - expected;
      if (!std::isfinite(error)) continue;
      ++valid;
      bad_1 += std::abs(error) > 1;
      bad_2 += std::abs(error) > 2;
      all_squares += error * error;
      if (std::abs(error) >= 1) continue;
      ++n;
      sum += error;
      squares += error * error;
      if (!deviation.empty()) stated += std::pow(deviation.at<float>(y, x), 2);
      const int k = std::min(kClasses - 1, static_cast<int>((expected - std::floor(expected)) * kClasses));
      class_sum[k] += error;
      ++class_count[k];
    }
  }
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (int k = 0; k < kClasses; ++k) {
    const bool enough = class_count[k] >= kLeastPerClass;
    low = std::min(low, enough ? class_sum[k] / class_count[k] : std::nan(""));
    high = std::max(high, enough ? class_sum[k] / class_count[k] : std::nan(""));
    if (!enough) low = high = std::nan("");
    if (!enough) break;
  }
  return {sum / n,
          std::sqrt(squares / n),
          high - low,
          deviation.empty() ? std::nan("") : std::sqrt(squares / stated),
          100 * (seen - valid) / seen,
          100 * bad_1 / valid,
          100 * bad_2 / valid,
          std::sqrt(all_squares / valid)};
}

void PrintHead() {
  const char* names[] = {"bias", "rms", "locking", "err/stated", "invalid %", "bad-1 %", "bad-2 %", "rms all"};
  std::printf(csv ? "%s,%s" : "%-36s %-16s", "pair", "matcher");
  for (const char* name : names) std::printf(csv ? ",%s" : " %10s", name);
  std::printf("\n");
}

void Print(const std::string& pair, const std::string& matcher, const Error& e) {
  std::printf(csv ? "%s,%s" : "%-36s %-16s", pair.c_str(), matcher.c_str());
  const auto number = [](double value, int digits) {
    if (std::isfinite(value)) {
      std::printf(csv ? ",%.*f" : " %10.*f", digits, value);
    } else {
      std::printf(csv ? ",%s" : " %10s", csv ? "" : "-");
    }
  };
  for (const double px : {e.bias_px, e.rms_px, e.locking_px}) number(px, 4);
  number(e.stated_ratio, 2);
  for (const double percent : {e.invalid, e.bad_1, e.bad_2}) number(percent, 2);
  number(e.whole_rms_px, 3);
  std::printf("\n");
  std::fflush(stdout);
}

struct Contender {
  const char* name;
  StereoOptions options;
  bool opencv = false;
};

StereoOptions Unrefined() {
  StereoOptions options;
  options.refine_radius_px = 0;
  return options;
}

const std::vector<Contender>& SpeckleContenders() {
  static const std::vector<Contender> all = {
      {"ours", {}, false}, {"ours unrefined", Unrefined(), false}, {"MODE_HH", {}, true}};
  return all;
}

StereoResult Match(const Contender& contender, const cv::Mat& left, const cv::Mat& right, DisparityRange range) {
  if (contender.opencv) return {OpenCVPeer(OpenCVMatcher::kHH, range).Disparity_px(left, right), {}};
  StereoResult result = MatchStereo(left, right, range, contender.options);
  if (contender.options.refine_radius_px == 0) result.deviation_px.release();
  return result;
}

constexpr int kRendered = 64;  // disparities
const cv::Size kRenderedSize(640, 480);

/// Clear of the edges by half a window of the largest kind, in both pictures; from the column on where every disparity
/// has a partner, since OpenCV gives none before it.
cv::Mat Inside(const cv::Mat& truth) {
  constexpr int kMargin_px = 16;
  cv::Mat mask = cv::Mat::zeros(truth.size(), CV_8UC1);
  for (int y = kMargin_px; y < truth.rows - kMargin_px; ++y) {
    for (int x = kRendered + kMargin_px; x < truth.cols - kMargin_px; ++x) {
      const float right = static_cast<float>(x) - truth.at<float>(y, x);
      mask.at<std::uint8_t>(y, x) = right >= kMargin_px && right < truth.cols - kMargin_px ? 255 : 0;
    }
  }
  return mask;
}

void CompareRendered(const std::string& name, const StereoSurface& surface, const RenderOptions& options) {
  const RenderedPair pair = RenderPair(kRenderedSize, surface, options);
  for (const Contender& contender : SpeckleContenders()) {
    const StereoResult result = Match(contender, pair.left, pair.right, {0, kRendered});
    Print(name, contender.name,
          Compare(result.disparity_px, result.deviation_px, pair.truth_px, Inside(pair.truth_px)));
  }
}

void SlantedPlanes() {
  for (const double slope : {0.03, 0.10}) {
    for (const double noise : {2.0, 6.0}) {
      const StereoSurface plane{[=](double x, double y) { return 4.3 + slope * (0.5 * x + 0.25 * y); }, 4, 50, false};
      char name[64];
      std::snprintf(name, sizeof name, "plane slope %.3f gain 0.7 noise %.0f", 0.5 * slope, noise);
      CompareRendered(name, plane, {noise, 0.7, 1});
    }
  }
}

void LevelPlanes() {
  for (int tenths = 0; tenths < 10; ++tenths) {
    const double level = 20 + 0.1 * tenths;
    const StereoSurface plane{[=](double, double) { return level; }, level, level, false};
    char name[64];
    std::snprintf(name, sizeof name, "level plane at %.1f noise 2", level);
    CompareRendered(name, plane, {2, 0.7, 2});
  }
}

/// Strips 96 px wide whose disparities alternate; figures near the steps count every valid pixel within 10 px of one.
void Steps() {
  constexpr double kStrip_px = 96, kNear_px = 10;
  for (const double step : {4.0, 12.0}) {
    const StereoSurface strips{
        [=](double x, double) { return 20.3 + (static_cast<int>(std::floor(x / kStrip_px)) % 2 != 0 ? step : 0); },
        20.3, 20.3 + step, true};
    const RenderedPair pair = RenderPair(kRenderedSize, strips, {2, 0.7, 3});
    cv::Mat near = Inside(pair.truth_px);
    for (int x = 0; x < near.cols; ++x) {
      const double past = std::fmod(x, kStrip_px);
      if (past > kNear_px && past < kStrip_px - kNear_px) near.col(x).setTo(0);
    }
    char name[64];
    std::snprintf(name, sizeof name, "steps of %.0f px noise 2", step);
    for (const Contender& contender : SpeckleContenders()) {
      const StereoResult result = Match(contender, pair.left, pair.right, {0, kRendered});
      Print(name, contender.name,
            Compare(result.disparity_px, result.deviation_px, pair.truth_px, Inside(pair.truth_px)));
      Print("near " + std::string(name), contender.name,
            Compare(result.disparity_px, result.deviation_px, pair.truth_px, near));
    }
  }
}

void Curves() {
  const auto wave = [](double amplitude, double period) {
    return StereoSurface{[=](double x, double y) {
                           const double k = 2 * std::numbers::pi / period;
                           return 25 + amplitude * std::sin(k * x) * std::cos(k * y);
                         },
                         25 - amplitude, 25 + amplitude, false};
  };
  CompareRendered("waves 5 px high 200 px long noise 2", wave(5, 200), {2, 0.7, 4});
  CompareRendered("waves 2 px high 60 px long noise 2", wave(2, 60), {2, 0.7, 5});
  CompareRendered("curved and slanted noise 2", CurvedSurface(kRenderedSize, kRendered), {2, 0.7, 6});
}

void Photographs(const fs::path& samples) {
  const std::vector<Contender> natural = {{"ours", {}, false},
                                          {"ours unrefined", Unrefined(), false},
                                          {"ours, natural pictures", ForNaturalPictures(), false},
                                          {"MODE_HH", {}, true}};
  for (const char* name : {"teddy", "cones", "flatboard", "bowl"}) {
    const fs::path folder = samples / "stereo" / name;
    if (!fs::exists(folder / "disparity.pfm")) {
      std::fprintf(stderr, "%s: %s is not here, not compared\n", name, folder.c_str());
      continue;
    }
    const cv::Mat left = cv::imread((folder / "left.png").string(), cv::IMREAD_GRAYSCALE);
    const cv::Mat right = cv::imread((folder / "right.png").string(), cv::IMREAD_GRAYSCALE);
    const cv::Mat truth = ReadPfm(folder / "disparity.pfm");
    // Middlebury's have the pixels both cameras see, and count from the column where every disparity has a partner.
    const bool middlebury = fs::exists(folder / "nonoccluded.png");
    const DisparityRange range = middlebury ? DisparityRange{0, 64} : DisparityRange{576, 128};
    cv::Mat mask(truth.size(), CV_8UC1, cv::Scalar(255));
    if (middlebury) {
      mask = cv::imread((folder / "nonoccluded.png").string(), cv::IMREAD_GRAYSCALE);
      mask.colRange(0, 64).setTo(0);
    }
    for (const Contender& contender : middlebury ? natural : SpeckleContenders()) {
      const StereoResult result = Match(contender, left, right, range);
      Print(name, contender.name, Compare(result.disparity_px, result.deviation_px, truth, mask));
    }
  }
}

int Main(int argc, char** argv) {
  fs::path samples = GRANARY_SAMPLES;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--csv") == 0) {
      csv = true;
    } else if (argv[i][0] != '-') {
      samples = argv[i];
    } else {
      std::fprintf(stderr, "usage: stereo_accuracy [--csv] [SAMPLES]\n");
      return 2;
    }
  }
  if (!csv) {
    std::printf(
        "bias, rms and locking in px, over errors below 1 px; err/stated: rms error over rms stated deviation, 1 is "
        "right;\n"
        "invalid in %% of the pixels both cameras see; bad-n: off by more than n px, %% of the valid; rms all: every "
        "valid "
        "pixel\n");
  }
  PrintHead();
  SlantedPlanes();
  LevelPlanes();
  Steps();
  Curves();
  Photographs(samples);
  return 0;
}

}  // namespace
}  // namespace granary

int main(int argc, char** argv) { return granary::Main(argc, argv); }
