// Two simulated cameras that speak GigE Vision, so that the real driver has something to drive.
#pragma once

#include <array>
#include <memory>
#include <string>

#include "drivers/options.h"
#include "drivers/rig.h"
#include "drivers/sim/scene.h"

namespace granary {

struct SimGigeOptions {
  /// Where the left and the right camera listen, port 3956 each; addresses of this machine.
  std::array<std::string, 2> addresses{"127.0.0.1", "127.0.0.2"};
  double lost_percent = 0;  ///< of the stream's packets, by chance; they are not sent again
};

/// Aravis' own fake cameras with the scene before them: control and stream over real sockets, Mono8 and Mono16,
/// exposure and gain (1 dB a step) as the client sets them, triggered by command or running free. A frame's id counts
/// the shots from 1 on, 65535 at most, then 1 again. A command is followed within a tenth of a second, as the fake
/// polls for it. Owned and used by one thread.
class SimGige {
 public:
  /// Both cameras are there when it returns.
  /// @throws std::invalid_argument for pictures larger than 2048 × 2048, and what SimScene refuses; std::runtime_error
  ///   naming an address that is not of this machine, or whose port is taken
  SimGige(const SimOptions& options, const RigWorld& world, const SimGigeOptions& gige);
  ~SimGige();
  SimGige(const SimGige&) = delete;
  SimGige& operator=(const SimGige&) = delete;

  /// By which the configuration finds a camera.
  [[nodiscard]] static std::string IdOf(Side side);

  /// The camera is gone, as when its cable is pulled; nothing when it is gone already.
  void Pull(Side side);
  /// It is back, as after power-on. @throws std::runtime_error as the constructor does
  void Plug(Side side);
  /// So much of what it streams is lost from now on; 100 silences it while it still answers.
  void Lose(Side side, double percent);
  /// The projector's lamp; it works at first.
  void SetLamp(bool works);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace granary
