// The files stand for triggers: every Arm moves on by one, whatever becomes of the frame, so that a pair of replay
// cameras stays in step when one of them meets a file it cannot read.
#include "drivers/camera_replay.h"

#include <stdexcept>
#include <utility>

#include "drivers/errors.h"
#include "pipeline/file_error.h"
#include "pipeline/frame_file.h"

namespace granary {

CameraReplay::CameraReplay(std::vector<std::filesystem::path> files) : files_(std::move(files)) {
  if (files_.empty()) throw std::invalid_argument("files: a replay camera needs at least one");
}

std::string CameraReplay::Id() const { return "replay:" + files_.front().string(); }

void CameraReplay::Arm() {
  current_ = next_;
  next_ = (next_ + 1) % files_.size();
  armed_ = true;
}

Frame CameraReplay::Grab(std::chrono::milliseconds) {
  if (!armed_)
    throw DeviceError(Reason::kFrameMissing, Id(), "grab", "the camera is not armed, or its frame was grabbed");
  armed_ = false;
  try {
    Frame frame = LoadFrame(files_[current_]);
    frame.frame_id = current_;
    frame.source = files_[current_].string();
    return frame;
  } catch (const FileError& error) {
    throw DeviceError(Reason::kFrameInvalid, Id(), "read", error.what());
  }
}

void CameraReplay::Disarm() noexcept { armed_ = false; }

}  // namespace granary
