// render_frames SIM_FOLDER OUT: what the guest's cameras will see, rendered here where it takes a second and not a
// minute. OUT receives stereo.yml and world.yml of a rig with small pictures, OUT/grain and OUT/empty raw grey pictures
// of the simulated bin with the projector lit and dark, and OUT/volume_m3 the truth.
#include <array>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <limits>
#include <stdexcept>
#include <string>

#include "drivers/sim/scene.h"
#include "pipeline/calibration_file.h"

namespace {

namespace fs = std::filesystem;

// Half the simulator's resolution, and of that the middle: 640×480 is a size that every camera knows.
constexpr int kWidth = 640, kHeight = 480;
constexpr int kNoises = 3;  // pictures of one scene, each with noise of its own

granary::StereoCalibration SmallPictures(granary::StereoCalibration calibration) {
  const double lost_rows = calibration.image_size.height / 4.0 - kHeight / 2.0;
  for (auto* K : {&calibration.K1, &calibration.K2}) {
    for (const int row : {0, 1}) {
      for (int column = 0; column < 3; ++column) (*K)(row, column) /= 2;
      (*K)(row, 2) -= 0.25;  // pixel centres lie at integers
    }
    (*K)(1, 2) -= lost_rows;
  }
  calibration.image_size = {kWidth, kHeight};
  return calibration;
}

void WritePicture(const fs::path& file, const cv::Mat& image) {
  std::ofstream out(file, std::ios::binary);
  for (int y = 0; y < image.rows; ++y) out.write(image.ptr<char>(y), image.cols);
  if (!out.flush()) throw std::runtime_error(file.string() + ": cannot be written");
}

void WriteScene(const fs::path& folder, granary::SimScene& scene) {
  fs::create_directories(folder);
  for (const bool lit : {true, false}) {
    for (int noise = 0; noise < kNoises; ++noise) {
      const auto pair = scene.Render(static_cast<std::uint64_t>(noise), lit);
      const std::string name = (lit ? "lit-" : "dark-") + std::to_string(noise) + ".grey";
      WritePicture(folder / ("left-" + name), pair.left.image);
      WritePicture(folder / ("right-" + name), pair.right.image);
    }
  }
}

void Render(const fs::path& sim_folder, const fs::path& out) {
  granary::RigWorld world;
  world.bin.id = 1;
  world.bin.name = "bay-1";
  world.bin.footprint_m = {{0.0, 0.0}, {0.52, 0.0}, {0.52, 0.355}, {0.0, 0.355}};
  world.bin.height_m = 0.285;
  world.calibration = SmallPictures(granary::LoadStereoCalibration(sim_folder / "stereo.yml"));
  world.world_from_left = granary::LoadWorldFromLeft(sim_folder / "world.yml");
  fs::create_directories(out);
  granary::SaveStereoCalibration(out / "stereo.yml", world.calibration);
  granary::SaveWorldFromLeft(out / "world.yml", world.world_from_left);

  granary::SimOptions options;
  options.volume_m3 = 0.019;
  granary::SimScene grain(options, world);
  WriteScene(out / "grain", grain);
  std::ofstream(out / "volume_m3") << std::setprecision(std::numeric_limits<double>::max_digits10)
                                   << grain.TruthVolume_m3() << '\n';
  world.empty_bin = true;
  granary::SimScene empty(options, world);
  WriteScene(out / "empty", empty);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "usage: render_frames SIM_FOLDER OUT\n";
    return 2;
  }
  try {
    Render(argv[1], argv[2]);
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "render_frames: " << error.what() << '\n';
    return 1;
  }
}
