// The formats are few and fixed, so they are written out here: PCL's own I/O library would bring a rendering toolkit
// along.
#include "pipeline/cloud_files.h"

#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "pipeline/file_bytes.h"
#include "pipeline/file_error.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

static_assert(std::endian::native == std::endian::little, "these files are little endian and written as memory lies");
static_assert(std::numeric_limits<float>::is_iec559);

constexpr long kLargestSide = 65535;

template <typename T>
void Append(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// The next line of a text header; nothing when the text ends first.
std::optional<std::string_view> NextLine(std::string_view bytes, std::size_t& at) {
  const std::size_t end = bytes.find('\n', at);
  if (end == std::string_view::npos) return std::nullopt;
  std::string_view line = bytes.substr(at, end - at);
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  at = end + 1;
  return line;
}

std::vector<Eigen::Vector3f> VertexNormals(const Surface& surface) {
  std::vector<Eigen::Vector3d> sums(surface.vertices_in_world.size(), Eigen::Vector3d::Zero());
  for (const auto& [a, b, c] : surface.triangles) {
    const Eigen::Vector3d& origin = surface.vertices_in_world.at(a);
    // Not normalised: its length is twice the area, the weight wanted.
    const Eigen::Vector3d normal =
        (surface.vertices_in_world.at(b) - origin).cross(surface.vertices_in_world.at(c) - origin);
    for (const std::uint32_t vertex : {a, b, c}) sums[vertex] += normal;
  }
  std::vector<Eigen::Vector3f> normals;
  normals.reserve(sums.size());
  for (const Eigen::Vector3d& sum : sums) {
    normals.emplace_back(sum.norm() > 0 ? Eigen::Vector3f(sum.normalized().cast<float>()) : Eigen::Vector3f::UnitZ());
  }
  return normals;
}

std::string PlyStart(std::size_t vertices) {
  return "ply\nformat binary_little_endian 1.0\ncomment metres, world frame, z up\nelement vertex " +
         std::to_string(vertices) + "\nproperty float x\nproperty float y\nproperty float z\n";
}
constexpr const char* kPlyColours = "property uchar red\nproperty uchar green\nproperty uchar blue\n";

std::string PlyBytes(const Surface& surface, bool with_faces) {
  if (surface.interpolated.size() != surface.vertices_in_world.size()) {
    throw std::logic_error("surface: one interpolated flag a vertex is wanted");
  }
  std::string bytes = PlyStart(surface.vertices_in_world.size()) +
                      "property float nx\nproperty float ny\nproperty float nz\n" + kPlyColours +
                      "property uchar interpolated\n";
  if (with_faces) {
    bytes += "element face " + std::to_string(surface.triangles.size()) + "\nproperty list uchar int vertex_indices\n";
  }
  bytes += "end_header\n";
  const std::vector<Eigen::Vector3f> normals = VertexNormals(surface);
  bytes.reserve(bytes.size() + normals.size() * 28 + (with_faces ? surface.triangles.size() * 13 : 0));
  for (std::size_t i = 0; i < normals.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) Append(bytes, static_cast<float>(surface.vertices_in_world[i][axis]));
    for (int axis = 0; axis < 3; ++axis) Append(bytes, normals[i][axis]);
    const bool completed = surface.interpolated[i] != 0;
    Append(bytes, completed ? kCompletedColour : kMeasuredColour);
    Append(bytes, static_cast<std::uint8_t>(completed ? 1 : 0));
  }
  if (with_faces) {
    for (const auto& triangle : surface.triangles) {
      Append(bytes, std::uint8_t{3});
      for (const std::uint32_t vertex : triangle) Append(bytes, static_cast<std::int32_t>(vertex));
    }
  }
  return bytes;
}

/// A whole number of 1 to 65535, nothing else on the line.
std::optional<int> SideLength(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value < 1 || value > kLargestSide)
    return std::nullopt;
  return value;
}

void CheckSize(const fs::path& file, std::size_t present, std::size_t wanted) {
  if (present == wanted) return;
  throw FileError(file, std::string(present < wanted ? "is truncated" : "is damaged") + ": its header says " +
                            std::to_string(wanted) + " bytes of data, it has " + std::to_string(present));
}

}  // namespace

void WritePfm(const fs::path& file, const cv::Mat& values) {
  if (values.type() != CV_32FC1 || values.empty())
    throw FileError(file, "cannot be written: one float channel is wanted");
  // A negative scale is the format's way to say little endian.
  std::string bytes = "Pf\n" + std::to_string(values.cols) + " " + std::to_string(values.rows) + "\n-1.0\n";
  for (int row = values.rows - 1; row >= 0; --row) {
    for (int col = 0; col < values.cols; ++col) {
      const float value = values.at<float>(row, col);
      Append(bytes, std::isfinite(value) ? value : std::numeric_limits<float>::infinity());
    }
  }
  WriteBytes(file, bytes);
}

cv::Mat ReadPfm(const fs::path& file) {
  const std::string bytes = ReadBytes(file);
  std::size_t at = 0;
  const auto magic = NextLine(bytes, at);
  if (magic == "PF") throw FileError(file, "is a colour PFM; one channel (Pf) is wanted");
  if (magic != "Pf") throw FileError(file, "is no PFM (it has to begin with Pf)");
  const auto size_line = NextLine(bytes, at);
  const auto scale_line = NextLine(bytes, at);
  int width = 0, height = 0;
  double scale = 0;
  if (!size_line || !scale_line || !(std::istringstream(std::string(*size_line)) >> width >> height) ||
      !(std::istringstream(std::string(*scale_line)) >> scale) || width < 1 || height < 1 || width > kLargestSide ||
      height > kLargestSide || scale == 0 || !std::isfinite(scale)) {
    throw FileError(file, "is a PFM with a damaged header; width, height and a scale other than 0 are wanted");
  }
  CheckSize(file, bytes.size() - at, std::size_t(width) * std::size_t(height) * 4);
  cv::Mat values(height, width, CV_32FC1);
  for (int row = height - 1; row >= 0; --row) {
    for (int col = 0; col < width; ++col, at += 4) {
      std::array<char, 4> raw{};
      std::memcpy(raw.data(), bytes.data() + at, 4);
      if (scale > 0) raw = {raw[3], raw[2], raw[1], raw[0]};
      values.at<float>(row, col) = std::bit_cast<float>(raw);
    }
  }
  return values;
}

void WritePlyCloud(const fs::path& file, const Surface& surface) { WriteBytes(file, PlyBytes(surface, false)); }
void WritePlyMesh(const fs::path& file, const Surface& surface) { WriteBytes(file, PlyBytes(surface, true)); }

void WritePlyPoints(const fs::path& file, std::span<const Eigen::Vector3f> points, std::span<const Rgb> colours) {
  if (colours.size() != points.size()) throw FileError(file, "cannot be written: one colour a point is wanted");
  std::string bytes = PlyStart(points.size()) + kPlyColours + "end_header\n";
  bytes.reserve(bytes.size() + points.size() * 15);
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) Append(bytes, points[i][axis]);
    Append(bytes, colours[i]);
  }
  WriteBytes(file, bytes);
}

void WritePcd(const fs::path& file, const cv::Mat& points, const cv::Mat& noise_m) {
  if (points.type() != CV_32FC3 || points.empty()) {
    throw FileError(file, "cannot be written: points of three floats are wanted");
  }
  const bool with_noise = !noise_m.empty();
  if (with_noise && (noise_m.type() != CV_32FC1 || noise_m.size() != points.size())) {
    throw FileError(file, "cannot be written: one float of noise a point is wanted");
  }
  std::ostringstream header;
  header << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
         << (with_noise ? "FIELDS x y z noise\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
                        : "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n")
         << "WIDTH " << points.cols << "\nHEIGHT " << points.rows << "\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS "
         << points.total() << "\nDATA binary\n";
  std::string bytes = header.str();
  bytes.reserve(bytes.size() + points.total() * (with_noise ? 16 : 12));
  for (int row = 0; row < points.rows; ++row) {
    for (int col = 0; col < points.cols; ++col) {
      Append(bytes, points.at<cv::Vec3f>(row, col));
      if (with_noise) Append(bytes, noise_m.at<float>(row, col));
    }
  }
  WriteBytes(file, bytes);
}

PcdCloud ReadPcd(const fs::path& file) {
  const std::string bytes = ReadBytes(file);
  std::map<std::string, std::string, std::less<>> header;
  std::size_t at = 0;
  while (header.find("DATA") == header.end()) {
    const auto line = NextLine(bytes, at);
    if (!line || at > 4096) throw FileError(file, "is no PCD, or its header is truncated (no DATA line)");
    if (line->empty() || line->front() == '#') continue;
    const std::size_t space = line->find(' ');
    header[std::string(line->substr(0, space))] =
        space == std::string_view::npos ? "" : std::string(line->substr(space + 1));
  }
  const auto expect = [&](const char* key, const std::string& value) {
    if (header[key] != value)
      throw FileError(file, std::string(key) + " is \"" + header[key] + "\"; \"" + value + "\" is wanted");
  };
  const bool with_noise = header["FIELDS"] == "x y z noise";
  expect("DATA", "binary");
  if (!with_noise) expect("FIELDS", "x y z");
  expect("SIZE", with_noise ? "4 4 4 4" : "4 4 4");
  expect("TYPE", with_noise ? "F F F F" : "F F F");
  expect("COUNT", with_noise ? "1 1 1 1" : "1 1 1");
  const auto width = SideLength(header["WIDTH"]);
  const auto height = SideLength(header["HEIGHT"]);
  if (!width || !height) throw FileError(file, "WIDTH and HEIGHT have to be whole numbers of 1 to 65535");
  CheckSize(file, bytes.size() - at, std::size_t(*width) * std::size_t(*height) * (with_noise ? 16 : 12));

  PcdCloud cloud{cv::Mat(*height, *width, CV_32FC3), with_noise ? cv::Mat(*height, *width, CV_32FC1) : cv::Mat()};
  for (int row = 0; row < *height; ++row) {
    for (int col = 0; col < *width; ++col) {
      std::memcpy(cloud.points.at<cv::Vec3f>(row, col).val, bytes.data() + at, 12);
      at += 12;
      if (!with_noise) continue;
      std::memcpy(&cloud.noise_m.at<float>(row, col), bytes.data() + at, 4);
      at += 4;
    }
  }
  return cloud;
}

}  // namespace granary
