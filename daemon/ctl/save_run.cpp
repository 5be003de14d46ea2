// One file an intermediate, each only when the run came that far: an old picture beside a new record would lie.
#include "daemon/ctl/save_run.h"

#include <array>
#include <cstdio>
#include <string>
#include <system_error>
#include <vector>

#include <opencv2/core.hpp>

#include "daemon/record_json.h"
#include "pipeline/cloud_files.h"
#include "pipeline/file_bytes.h"
#include "pipeline/frame_file.h"
#include "pipeline/pictures.h"
#include "pipeline/removed.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

/// Grey as an 8- or 16-bit picture, values kept.
cv::Mat AsPicture(const cv::Mat& grey) {
  double brightest = 0;
  cv::minMaxIdx(grey, nullptr, &brightest);
  cv::Mat picture;
  grey.convertTo(picture, brightest > 255 ? CV_16U : CV_8U);
  return picture;
}

std::string GrainTitle(const cv::Mat& mask) {
  char text[80];
  std::snprintf(text, sizeof text, "grain: %.1f %% of the pixels",
                100.0 * cv::countNonZero(mask) / static_cast<double>(mask.total()));
  return text;
}

std::string VolumeTitle(const Measurement& m, const Bin& bin) {
  std::string title = bin.name.empty() ? "bin " + std::to_string(bin.id) : bin.name;
  title += ", " + UtcText(m.utc);
  char figures[80] = "";
  if (m.volume_m3) std::snprintf(figures, sizeof figures, ": %.5g m3", *m.volume_m3);
  title += figures;
  if (m.simulated) title += " (simulated)";
  return title;
}

void SaveRemoved(const fs::path& picture_file, const fs::path& cloud_file, const RigView& view, const Bin& bin) {
  const RemovedPoints removed = FindRemoved(view.points_in_world, view.grain_mask, bin);
  SaveFrame(picture_file,
            RemovedPicture(view.points_in_world, view.grain_mask, removed, bin, "points removed, seen from above"));
  std::vector<Rgb> colours;
  for (const Removal why : removed.why) colours.push_back(ColourOf(why));
  WritePlyPoints(cloud_file, removed.points_in_world, colours);
}

void SaveView(const fs::path& folder, const std::string& prefix, const RigView& view, const Bin& bin) {
  const auto named = [&](const char* name) { return folder / (prefix + name); };
  if (!view.left.empty() && !view.right.empty()) {
    SaveFrame(named("rectified.png"), RectifiedPicture(view.left, view.right));
    SaveFrame(named("left_rectified.png"), AsPicture(view.left));
    SaveFrame(named("right_rectified.png"), AsPicture(view.right));
  }
  if (!view.disparity_px.empty()) {
    SaveFrame(named("disparity.png"), DisparityPicture(view.disparity_px, "disparity, rectified left"));
    WritePfm(named("disparity.pfm"), view.disparity_px);
  }
  if (!view.points_in_world.empty()) WritePcd(named("cloud.pcd"), view.points_in_world);
  if (!view.grain_mask.empty() && !view.left.empty()) {
    SaveFrame(named("grain.png"), MaskPicture(view.left, view.grain_mask, GrainTitle(view.grain_mask)));
  }
  if (!view.points_in_world.empty() && !view.grain_mask.empty()) {
    SaveRemoved(named("removed.png"), named("removed.ply"), view, bin);
  }
}

}  // namespace

void SaveRun(const fs::path& folder, const ChosenBin& bin, const PipelineRun& run) {
  MakeFolder(folder);
  for (std::size_t i = 0; i < bin.rigs.size(); ++i) {
    const std::string prefix = bin.rigs.size() > 1 ? bin.rigs[i].options.name + "_" : "";
    for (const char* name : {"rectified.png", "left_rectified.png", "right_rectified.png", "disparity.png",
                             "disparity.pfm", "cloud.pcd", "grain.png", "removed.png", "removed.ply"}) {
      std::error_code ignored;
      fs::remove(folder / (prefix + name), ignored);
    }
    if (i < run.rigs.size()) SaveView(folder, prefix, run.rigs[i], bin.config.bin);
  }
  for (const char* name : {"height.png", "mesh.png", "cloud.ply", "mesh.ply"}) {
    std::error_code ignored;
    fs::remove(folder / name, ignored);
  }
  if (!run.surface.Empty()) {
    const std::string title = VolumeTitle(run.measurement, bin.config.bin);
    SaveFrame(folder / "height.png", HeightPicture(run.surface, bin.config.bin, title));
    SaveFrame(folder / "mesh.png", MeshPicture(run.surface, bin.config.bin, title));
    WritePlyCloud(folder / "cloud.ply", run.surface);
    WritePlyMesh(folder / "mesh.ply", run.surface);
  }
  WriteBytes(
      folder / "record.json",
      RecordToJson(run.measurement).dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
  Say("saved in " + folder.string());
}

}  // namespace granary
