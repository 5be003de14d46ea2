// granary-sim-gige: the cameras of a rig, simulated on the network. What they see comes from the rig's [bin.rig.sim],
// so that the daemon, with the same file and driver = "aravis", measures that bin over the real protocol.
#include <CLI/CLI.hpp>

#include <poll.h>
#include <signal.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <iterator>
#include <memory>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include "daemon/ctl/command.h"
#include "daemon/ctl/setup.h"
#include "daemon/modbus/socket.h"
#include "drivers/sim/gige.h"

namespace granary {
namespace {

constexpr auto kCommands = R"(Lines on standard input while it runs:
  pull left|right            the camera is gone
  plug left|right            it is back
  lose left|right PERCENT    so much of its stream is lost from now on; 100 silences it
  lamp on|off                the projector)";

struct Arguments {
  std::string rig;
  bool empty = false, dark = false;
  SimGigeOptions gige;
};

/// Held back for the loop below; to be called first: threads inherit it.
FileDescriptor HoldSignals() {
  sigset_t ending;
  sigemptyset(&ending);
  sigaddset(&ending, SIGTERM);
  sigaddset(&ending, SIGINT);
  if (pthread_sigmask(SIG_BLOCK, &ending, nullptr) != 0) throw std::logic_error("pthread_sigmask");
  FileDescriptor signals(signalfd(-1, &ending, SFD_CLOEXEC));
  if (signals.Get() < 0) throw std::system_error(errno, std::generic_category(), "signalfd");
  return signals;
}

std::optional<Side> SideNamed(const std::string& name) {
  if (name == "left") return Side::kLeft;
  if (name == "right") return Side::kRight;
  return std::nullopt;
}

/// @throws UsageError for what is no command; std::runtime_error when the camera cannot be plugged in
void Obey(const std::string& line, SimGige& cameras) {
  std::istringstream in(line);
  const std::vector<std::string> words{std::istream_iterator<std::string>(in), {}};
  const auto is = [&](const char* verb, std::size_t count) { return words.size() == count && words[0] == verb; };
  const auto side = words.size() > 1 ? SideNamed(words[1]) : std::nullopt;
  char* end = nullptr;
  const double percent = words.size() > 2 ? std::strtod(words[2].c_str(), &end) : -1;
  if (is("pull", 2) && side) {
    cameras.Pull(*side);
  } else if (is("plug", 2) && side) {
    cameras.Plug(*side);
  } else if (is("lose", 3) && side && *end == '\0' && percent >= 0 && percent <= 100) {
    cameras.Lose(*side, percent);
  } else if (is("lamp", 2) && (words[1] == "on" || words[1] == "off")) {
    cameras.SetLamp(words[1] == "on");
  } else {
    throw UsageError("'" + line + "' is no command; granary-sim-gige --help lists them");
  }
}

/// Obeys standard input until it ends or a signal comes.
void Serve(SimGige& cameras, const FileDescriptor& signals) {
  std::string typed;
  std::array<pollfd, 2> waits{{{signals.Get(), POLLIN, 0}, {STDIN_FILENO, POLLIN, 0}}};
  for (;;) {
    if (poll(waits.data(), waits.size(), -1) < 0) {
      if (errno == EINTR) continue;
      throw std::system_error(errno, std::generic_category(), "poll");
    }
    if (waits[0].revents != 0) return;
    if (waits[1].revents == 0) continue;
    std::array<char, 256> bytes{};
    const auto count = read(STDIN_FILENO, bytes.data(), bytes.size());
    if (count <= 0) {
      waits[1].fd = -1;  // ended, or there is none: only a signal counts from here on
      continue;
    }
    typed.append(bytes.data(), static_cast<std::size_t>(count));
    for (auto end = typed.find('\n'); end != std::string::npos; end = typed.find('\n')) {
      const std::string line = typed.substr(0, end);
      typed.erase(0, end + 1);
      if (line.empty()) continue;
      try {
        Obey(line, cameras);
        std::cout << "done: " << line << std::endl;
      } catch (const std::runtime_error& error) {
        Say("granary-sim-gige: " + std::string(error.what()));
      }
    }
  }
}

int Run(const GlobalOptions& global, const Arguments& arguments) {
  const FileDescriptor signals = HoldSignals();
  const ChosenBin bin = ChooseBin(global, arguments.rig);
  const ChosenRig& rig = OnlyRig(bin);
  const std::string name = "bin " + std::to_string(bin.config.bin.id) + ", rig " + rig.options.name;
  std::unique_ptr<SimGige> cameras;
  try {
    cameras = std::make_unique<SimGige>(rig.options.sim, WorldOf(bin, rig, arguments.empty), arguments.gige);
  } catch (const std::invalid_argument& error) {
    throw std::runtime_error(global.config.string() + ", " + name + ", " + rig.options.calibration.string() + ": " +
                             error.what());
  }
  if (arguments.dark) cameras->SetLamp(false);
  std::cout << name << (arguments.empty ? ", empty" : "") << ": simulated GigE cameras at "
            << arguments.gige.addresses[0] << " and " << arguments.gige.addresses[1]
            << "\n  left  = { driver = \"aravis\", id = \"" << SimGige::IdOf(Side::kLeft) << "\" }"
            << "\n  right = { driver = \"aravis\", id = \"" << SimGige::IdOf(Side::kRight) << "\" }" << std::endl;
  Serve(*cameras, signals);
  return kExitDone;
}

int Main(int argc, char** argv) {
  spdlog::set_default_logger(std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::stderr_sink_mt>()));
  spdlog::set_pattern("%l: %v");

  CLI::App app("Simulates the two cameras of a rig as GigE Vision cameras, until SIGTERM or SIGINT.",
               "granary-sim-gige");
  GlobalOptions global;
  Arguments arguments;
  app.add_option("-c,--config", global.config, "configuration file")->capture_default_str();
  app.add_option("--bin", global.bin, "id of the bin; needed where there are several");
  app.add_option("--rig", arguments.rig, "the rig; needed where there are several")->type_name("NAME");
  app.add_option("--left", arguments.gige.addresses[0], "address of the left camera, one of this machine's")
      ->capture_default_str()
      ->type_name("ADDR");
  app.add_option("--right", arguments.gige.addresses[1], "of the right one")->capture_default_str()->type_name("ADDR");
  app.add_option("--lost-percent", arguments.gige.lost_percent, "of the stream's packets that are lost")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 100.0));
  app.add_flag("--empty", arguments.empty, "the bin without grain, for taking the reference");
  app.add_flag("--dark", arguments.dark, "the projector's lamp is dead");
  app.footer(kCommands);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitDone : kExitBadUsage;
  }
  try {
    return Run(global, arguments);
  } catch (const UsageError& error) {
    Say("granary-sim-gige: " + std::string(error.what()));
    return kExitBadUsage;
  } catch (const std::exception& error) {
    Say("granary-sim-gige: " + std::string(error.what()));
    return kExitFailed;
  }
}

}  // namespace
}  // namespace granary

int main(int argc, char** argv) { return granary::Main(argc, argv); }
