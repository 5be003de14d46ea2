// A GigE Vision camera of Aravis' own in this process, on one address of lo.
#pragma once

#include <arv.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>

#include <opencv2/core/mat.hpp>

namespace granary {

/// Its pictures are patterns that tell the camera and the frame, so that no pixel can be wrong unseen.
class FakeGige {
 public:
  struct Options {
    std::string address = "127.0.0.1";
    std::string serial = "L";
    std::uint8_t mark = 1;       ///< in every pattern
    bool more_features = false;  ///< those of kMoreFeatures as well
  };
  FakeGige() : FakeGige(Options{}) {}
  explicit FakeGige(const Options& options);
  ~FakeGige();
  FakeGige(const FakeGige&) = delete;
  FakeGige& operator=(const FakeGige&) = delete;

  /// Share of the packets that are lost on the way.
  void LosePackets(double share);
  [[nodiscard]] std::uint32_t Register(std::uint32_t address) const;
  void SetRegister(std::uint32_t address, std::uint32_t value);
  void SetLatchedTime(std::int64_t time_ns);
  [[nodiscard]] int FramesMade() const { return frames_made_; }

 private:
  static void Fill(ArvBuffer* buffer, void* self, guint32 exposure_us, guint32 gain, ArvPixelFormat format);

  std::uint8_t mark_;
  std::atomic<int> frames_made_{0};
  std::string features_file_;
  ArvGvFakeCamera* camera_ = nullptr;
};

// Registers of the fake and of kMoreFeatures.
constexpr std::uint32_t kPacketDelayRegister = 0x0d08;
constexpr std::uint32_t kPtpStatusRegister = 0x8014;

/// Is every pixel of the picture what the camera `mark` made for its frame?
[[nodiscard]] bool IsWhole(const cv::Mat& picture, std::uint8_t mark);
/// Which of its frames a camera says this is, from 0.
[[nodiscard]] int FrameNumber(const cv::Mat& picture);

}  // namespace granary
