// Rows of floats for the vector code of the refinement: aligned, with room on both sides for windows and whole vectors.
#pragma once

#include <opencv2/core/mat.hpp>

namespace granary {

constexpr int kRefineLanes = 16;         ///< most lanes a vector of the refinement has
constexpr int kRefineMaxRadius_px = 15;  ///< largest half window the rows have room for
constexpr int kRefinePad = 48;           ///< floats that may be read before the first and after the last pixel

/// Pixels of a row that the vector code computes: the width rounded up to whole vectors, whatever the instruction set.
[[nodiscard]] constexpr int RefineWidth(int width) { return (width + kRefineLanes - 1) / kRefineLanes * kRefineLanes; }

/// `count` rows of RefineWidth(width) floats with kRefinePad more on both sides, all `value` at first. Row(i) points at
/// the first pixel of row i modulo `count`, so that a band of any height can run through the same few rows.
class RowRing {
 public:
  RowRing(int count, int width, float value)
      : rows_(count, RefineWidth(width) + 2 * kRefinePad, CV_32FC1, cv::Scalar(value)) {}
  void Fill(float value) { rows_.setTo(value); }
  [[nodiscard]] float* Row(int i) { return rows_.ptr<float>((i % rows_.rows + rows_.rows) % rows_.rows) + kRefinePad; }

 private:
  cv::Mat rows_;
};

}  // namespace granary
