// granaryctl disparity: the matcher alone, on a pair that is rectified already; made for trying it on known pictures.
#include <CLI/CLI.hpp>

#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "daemon/ctl/command.h"
#include "daemon/ctl/setup.h"
#include "pipeline/cloud_files.h"
#include "pipeline/file_error.h"
#include "pipeline/frame_file.h"
#include "pipeline/stereo/match.h"

namespace granary {
namespace {

struct DisparityArguments {
  std::string left, right, out;
  DisparityRange range;
};

/// Grey; public test pictures come in colour, so here colour is turned into grey and said to be.
cv::Mat ReadGrey(const std::string& file) {
  cv::Mat image = ReadImage(file);
  if (image.channels() == 1) return image;
  Say(file + ": is in colour, turned into grey");
  cv::cvtColor(image, image, image.channels() == 4 ? cv::COLOR_BGRA2GRAY : cv::COLOR_BGR2GRAY);
  return image;
}

int Disparity(const GlobalOptions& global, const DisparityArguments& arguments) {
  const cv::Mat left = ReadGrey(arguments.left);
  const cv::Mat right = ReadGrey(arguments.right);
  if (left.size() != right.size()) {
    throw FileError(arguments.right, "right is " + std::to_string(right.cols) + "x" + std::to_string(right.rows) +
                                         ", left (" + arguments.left + ") is " + std::to_string(left.cols) + "x" +
                                         std::to_string(left.rows) + "; both must have one size");
  }
  if (left.depth() != right.depth()) {
    throw FileError(arguments.right, std::string("right is ") + (right.depth() == CV_8U ? "8" : "16") + "-bit, left (" +
                                         arguments.left + ") is " + (left.depth() == CV_8U ? "8" : "16") +
                                         "-bit; both must have one depth");
  }
  const double start_ms = SteadyMilliseconds();
  const StereoResult result = MatchStereo(left, right, arguments.range, StereoOptions{});
  const double match_ms = SteadyMilliseconds() - start_ms;
  WritePfm(arguments.out, result.disparity_px);

  const cv::Mat valid = cv::abs(result.disparity_px) < 1e6F;  // invalid is +inf
  const double valid_percent = 100.0 * cv::countNonZero(valid) / static_cast<double>(valid.total());
  char line[120];
  std::snprintf(line, sizeof line, ": %dx%d, %.1f %% matched, %.0f ms", left.cols, left.rows, valid_percent, match_ms);
  Say(arguments.out + line);
  if (global.json) {
    PrintJson({{"out", arguments.out},
               {"width", left.cols},
               {"height", left.rows},
               {"min_disparity", arguments.range.min_px},
               {"num_disparities", arguments.range.count},
               {"valid_percent", valid_percent},
               {"match_ms", match_ms}});
  }
  return kExitDone;
}

}  // namespace

void AddDisparity(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  const auto arguments = std::make_shared<DisparityArguments>();
  CLI::App* command = app.add_subcommand("disparity", "match a rectified pair of pictures");
  command->add_option("left", arguments->left, "rectified left picture")->required()->type_name("LEFT");
  command->add_option("right", arguments->right, "rectified right picture")->required()->type_name("RIGHT");
  command->add_option("--min-disparity", arguments->range.min_px, "smallest disparity searched, px")
      ->check(CLI::Range(-65535, 65535))
      ->capture_default_str();
  command->add_option("--num-disparities", arguments->range.count, "how many are searched")
      ->required()
      ->check(CLI::Range(1, 65535));
  command->add_option("-o,--out", arguments->out, "disparity map, PFM; invalid is +inf")
      ->required()
      ->type_name("OUT.pfm");
  command->callback([=, &global, &chosen] { chosen = [=, &global] { return Disparity(global, *arguments); }; });
}

}  // namespace granary
