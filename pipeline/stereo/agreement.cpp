// Pixel by pixel: meant for the few that the refinement could not settle.
#include "pipeline/stereo/agreement.h"

#include <algorithm>
#include <cmath>

namespace granary {

double ExplainedContrast(const cv::Mat& left, const cv::Mat& right, int x, int y, double disparity_px,
                         int half_width_px, int half_height_px) {
  const int x0 = std::max(0, x - half_width_px), x1 = std::min(left.cols - 1, x + half_width_px);
  const int y0 = std::max(0, y - half_height_px), y1 = std::min(left.rows - 1, y + half_height_px);
  const int shift = static_cast<int>(std::floor(-disparity_px));
  const float part = static_cast<float>(-disparity_px - shift);  // between columns x + shift and x + shift + 1
  if (x0 + shift < 0 || x1 + shift + 1 >= right.cols) return 0;
  double n = 0, l = 0, r = 0, ll = 0, rr = 0, lr = 0;
  for (int v = y0; v <= y1; ++v) {
    const float* left_row = left.ptr<float>(v);
    const float* right_row = right.ptr<float>(v) + shift;
    for (int u = x0; u <= x1; ++u) {
      const double a = left_row[u], b = right_row[u] + part * (right_row[u + 1] - right_row[u]);
      ++n;
      l += a;
      r += b;
      ll += a * a;
      rr += b * b;
      lr += a * b;
    }
  }
  const double left_variance = ll - l * l / n, right_variance = rr - r * r / n, covariance = lr - l * r / n;
  constexpr double kFlat = 1e-9;  // of the sum of squares: rounding
  if (left_variance <= kFlat * ll || right_variance <= kFlat * rr || !(covariance > 0)) return 0;
  return covariance * covariance / (left_variance * right_variance);
}

}  // namespace granary
