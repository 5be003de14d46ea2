// The first pixels carry the mark and the frame's number, all others follow from them.
#include "tests/drivers/aravis/fake_gige.h"

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <stdexcept>
#include <string_view>

#include <unistd.h>

#include <opencv2/core.hpp>

namespace granary {
namespace {

/// A thermometer, decibels, PTP, a clock to read, and a feature that takes less than it says.
constexpr std::string_view kMoreFeatures = R"(
<IntReg Name="DeviceTemperature"><Address>0x8000</Address><Length>4</Length><AccessMode>RO</AccessMode>
  <pPort>Device</pPort><Sign>Signed</Sign><Endianess>BigEndian</Endianess></IntReg>
<Float Name="Gain"><pValue>GainFloat</pValue><Min>0</Min><Max>24</Max><Unit>dB</Unit></Float>
<FloatReg Name="GainFloat"><Address>0x8004</Address><Length>4</Length><AccessMode>RW</AccessMode>
  <pPort>Device</pPort><Endianess>BigEndian</Endianess></FloatReg>
<Boolean Name="PtpEnable"><pValue>PtpEnableReg</pValue></Boolean>
<IntReg Name="PtpEnableReg"><Address>0x8010</Address><Length>4</Length><AccessMode>RW</AccessMode>
  <pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
<Enumeration Name="PtpStatus"><EnumEntry Name="Listening"><Value>0</Value></EnumEntry>
  <EnumEntry Name="Slave"><Value>1</Value></EnumEntry><pValue>PtpStatusReg</pValue></Enumeration>
<IntReg Name="PtpStatusReg"><Address>0x8014</Address><Length>4</Length><AccessMode>RW</AccessMode>
  <pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
<Command Name="TimestampLatch"><pValue>TimestampLatchReg</pValue><CommandValue>1</CommandValue></Command>
<IntReg Name="TimestampLatchReg"><Address>0x8018</Address><Length>4</Length><AccessMode>WO</AccessMode>
  <pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
<IntReg Name="TimestampLatchValue"><Address>0x8020</Address><Length>8</Length><AccessMode>RO</AccessMode>
  <pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
<Integer Name="Narrow"><pValue>NarrowReg</pValue><Min>0</Min><Max>100</Max></Integer>
<MaskedIntReg Name="NarrowReg"><Address>0x8028</Address><Length>4</Length><AccessMode>RW</AccessMode>
  <pPort>Device</pPort><LSB>31</LSB><MSB>28</MSB><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></MaskedIntReg>
</RegisterDescription>)";
constexpr std::uint32_t kLatchedTimeRegister = 0x8020;
constexpr int kHeadPixels = 4;

/// Grey value of a pixel, spread over all bits.
std::uint32_t PatternAt(std::uint32_t head, std::size_t index) {
  std::uint32_t value = head * 2654435761u + static_cast<std::uint32_t>(index) * 40503u;
  value ^= value >> 15;
  value *= 2246822519u;
  return value ^ (value >> 13);
}

std::uint32_t HeadOf(std::uint8_t mark, int number) {
  return static_cast<std::uint32_t>(mark) << 24 | (static_cast<std::uint32_t>(number) & 0xffffffu);
}

template <typename Pixel>
void FillPixels(Pixel* pixels, std::size_t count, std::uint32_t head) {
  for (std::size_t i = 0; i < count; ++i) {
    pixels[i] = static_cast<Pixel>(i < kHeadPixels ? head >> (8 * i) & 255 : PatternAt(head, i));
  }
}

template <typename Pixel>
std::uint32_t ReadHead(const cv::Mat& picture) {
  std::uint32_t head = 0;
  for (int i = 0; i < kHeadPixels; ++i) head |= static_cast<std::uint32_t>(picture.at<Pixel>(0, i)) << (8 * i);
  return head;
}

std::uint32_t ReadHead(const cv::Mat& picture) {
  return picture.depth() == CV_8U ? ReadHead<std::uint8_t>(picture) : ReadHead<std::uint16_t>(picture);
}

std::string WriteMoreFeatures() {
  ArvFakeCamera* plain = arv_fake_camera_new("plain");
  std::size_t size = 0;
  const char* text = arv_fake_camera_get_genicam_xml(plain, &size);
  std::string xml(text, size);
  g_object_unref(plain);
  const auto end = xml.rfind("</RegisterDescription>");
  if (end == std::string::npos) throw std::runtime_error("FakeGige: the fake's features have another form");
  xml.replace(end, std::string::npos, kMoreFeatures);

  char file[] = "/tmp/fake_gige_XXXXXX";
  const int fd = mkstemp(file);
  if (fd < 0) throw std::runtime_error("FakeGige: no file in /tmp");
  close(fd);
  std::ofstream(file) << xml;
  return file;
}

}  // namespace

FakeGige::FakeGige(const Options& options) : mark_(options.mark) {
  if (options.more_features) features_file_ = WriteMoreFeatures();
  camera_ = arv_gv_fake_camera_new_full(options.address.c_str(), options.serial.c_str(),
                                        features_file_.empty() ? nullptr : features_file_.c_str());
  if (camera_ == nullptr || !arv_gv_fake_camera_is_running(camera_)) {
    throw std::runtime_error("FakeGige: cannot run on " + options.address);
  }
  ArvFakeCamera* inner = arv_gv_fake_camera_get_fake_camera(camera_);
  arv_fake_camera_set_fill_pattern(inner, &FakeGige::Fill, this);
  arv_fake_camera_set_trigger_frequency(inner, 500);
}

FakeGige::~FakeGige() {
  if (camera_ != nullptr) g_object_unref(camera_);
  if (!features_file_.empty()) std::remove(features_file_.c_str());
}

void FakeGige::Fill(ArvBuffer* buffer, void* self, guint32, guint32, ArvPixelFormat format) {
  auto& fake = *static_cast<FakeGige*>(self);
  // The buffer's own size counts what was received, which is nothing here.
  void* data = const_cast<void*>(arv_buffer_get_data(buffer, nullptr));
  const auto pixels = static_cast<std::size_t>(arv_buffer_get_image_width(buffer)) *
                      static_cast<std::size_t>(arv_buffer_get_image_height(buffer));
  const std::uint32_t head = HeadOf(fake.mark_, fake.frames_made_++);
  if (format == ARV_PIXEL_FORMAT_MONO_16) {
    FillPixels(static_cast<std::uint16_t*>(data), pixels, head);
  } else {
    FillPixels(static_cast<std::uint8_t*>(data), pixels, head);
  }
}

void FakeGige::LosePackets(double share) { g_object_set(camera_, "gvsp-lost-ratio", share, nullptr); }

std::uint32_t FakeGige::Register(std::uint32_t address) const {
  guint32 value = 0;
  arv_fake_camera_read_register(arv_gv_fake_camera_get_fake_camera(camera_), address, &value);
  return value;
}

void FakeGige::SetRegister(std::uint32_t address, std::uint32_t value) {
  arv_fake_camera_write_register(arv_gv_fake_camera_get_fake_camera(camera_), address, value);
}

void FakeGige::SetLatchedTime(std::int64_t time_ns) {
  const auto big_endian = GINT64_TO_BE(time_ns);
  arv_fake_camera_write_memory(arv_gv_fake_camera_get_fake_camera(camera_), kLatchedTimeRegister, sizeof big_endian,
                               &big_endian);
}

bool IsWhole(const cv::Mat& picture, std::uint8_t mark) {
  const std::uint32_t head = ReadHead(picture);
  if (head >> 24 != mark) return false;
  cv::Mat made(picture.size(), picture.type());
  if (picture.depth() == CV_8U) {
    FillPixels(made.ptr<std::uint8_t>(), made.total(), head);
  } else {
    FillPixels(made.ptr<std::uint16_t>(), made.total(), head);
  }
  return cv::norm(picture, made, cv::NORM_INF) == 0;
}

int FrameNumber(const cv::Mat& picture) { return static_cast<int>(ReadHead(picture) & 0xffffffu); }

}  // namespace granary
