// Thirty calibrations from the same boards with fresh noise: they scatter as their covariances say.
#include <cmath>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "tests/pipeline/simulated_boards.h"

namespace granary {
namespace {

constexpr int kCalibrations = 30;
// Squared errors over their variances sum to chi-square with 30 degrees of freedom: 99.9 % of it lie between these.
constexpr double kLeast = 11.6, kMost = 59.7;

/// A quantity that is linear in the parameters near the truth: its error, and its gradient where that is not 0.
struct Quantity {
  const char* name;
  double error;
  std::vector<std::pair<int, double>> gradient;
};

std::vector<Quantity> QuantitiesOf(const StereoCalibration& found, const StereoCalibration& truth) {
  const cv::Vec3d t = found.T_m / cv::norm(found.T_m);
  cv::Vec3d turn;
  cv::Rodrigues(found.R * truth.R.t(), turn);
  const double f = truth.K2(0, 0);
  const double offset_px = found.K1(0, 2) - truth.K1(0, 2) - (found.K2(0, 2) - truth.K2(0, 2)) - f * turn[1];
  return {{"baseline", found.Baseline_m() - truth.Baseline_m(), {{21, t[0]}, {22, t[1]}, {23, t[2]}}},
          {"fx1", found.K1(0, 0) - truth.K1(0, 0), {{0, 1}}},
          {"fy2", found.K2(1, 1) - truth.K2(1, 1), {{10, 1}}},
          {"cx1", found.K1(0, 2) - truth.K1(0, 2), {{2, 1}}},
          {"k1 of the left camera", found.D1[0] - truth.D1[0], {{4, 1}}},
          {"disparity offset", offset_px, {{2, 1}, {11, -1}, {19, -f}}}};
}

TEST(StereoCovariance, IsTheScatterOfThirtyCalibrations) {
  const StereoCalibration truth = LabPair();
  const BoardViews boards = SimulatedBoards(truth, 16, 1);
  std::vector<double> sums;
  std::vector<Quantity> quantities;
  for (int i = 0; i < kCalibrations; ++i) {
    const StereoCalibration found = CalibrateBoards(Noisy(boards, 0.1, 100 + i), truth);
    quantities = QuantitiesOf(found, truth);
    sums.resize(quantities.size());
    for (std::size_t q = 0; q < quantities.size(); ++q) {
      double variance = 0;
      for (const auto& [row, a] : quantities[q].gradient) {
        for (const auto& [col, b] : quantities[q].gradient) variance += a * b * found.covariance.at<double>(row, col);
      }
      sums[q] += quantities[q].error * quantities[q].error / variance;
    }
  }
  for (std::size_t q = 0; q < sums.size(); ++q) {
    EXPECT_GT(sums[q], kLeast) << quantities[q].name;
    EXPECT_LT(sums[q], kMost) << quantities[q].name;
  }
}

}  // namespace
}  // namespace granary
