// Pictures whose bytes are easy and hard to pack, and the fault of a file that cannot be read.
#pragma once

#include <functional>
#include <string>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "pipeline/file_error.h"

namespace granary {

/// Left half noise (fills the tables of a packer), right half one grey (its longest runs), a ramp below.
inline cv::Mat TestPicture(int type, int width = 331, int height = 97) {
  cv::Mat image(height, width, type);
  cv::setRNGSeed(11);
  cv::randu(image, 0, image.depth() == CV_8U ? 256 : 65536);
  image.colRange(width / 2, width).setTo(cv::Scalar::all(77));
  for (int u = 0; u < width; ++u) image.col(u).rowRange(height * 3 / 4, height).setTo(cv::Scalar::all(u % 251));
  return image;
}

inline bool SamePicture(const cv::Mat& a, const cv::Mat& b) {
  return a.type() == b.type() && a.size() == b.size() && cv::norm(a, b, cv::NORM_INF) == 0;
}

/// `text` with the first `from` made `to`; a test that spoils what is not there has failed.
inline std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

/// The text of the FileError that `action` throws; empty (and a failure) when it throws none.
inline std::string FaultOf(const std::function<void()>& action) {
  try {
    action();
  } catch (const FileError& error) {
    return error.what();
  }
  ADD_FAILURE() << "no FileError";
  return {};
}

}  // namespace granary
