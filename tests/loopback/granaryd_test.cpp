// The daemon as its users meet it: a process, a configuration file, signals and a Modbus client that is not ours.
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fstream>

#include "daemon/modbus/socket.h"
#include "daemon/record_json.h"
#include "daemon/store.h"
#include "tests/loopback/daemon_process.h"
#include "tests/loopback/half_size_rig.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {
namespace {

constexpr int kStatusWord = 0, kReason = 2, kHeartbeat = 4, kSequence = 5, kUtc = 6, kVolume = 10, kErrorRate = 36;
constexpr int kValid = 1 << 0, kHeld = 1 << 1, kSimulated = 1 << 4;
// mbpoll prints floats with six digits: half a unit of the last one is at most 5e-6, and float32 itself adds 6e-8.
constexpr double kPrinted = 5.1e-6;

/// A depot with one simulated bin, small pictures, and one measurement an hour: figures stand still while they are
/// read.
class Granaryd : public testing::Test {
 protected:
  void SetUp() override {
    WriteHalfSizeRig(folder_.path());
    Configure();
  }

  void Configure(const std::string& name = "bay-1", const std::string& sim = "") {
    std::ofstream(config_) << "[modbus.tcp]\nlisten = \"127.0.0.1:" << port_ << "\"\n"
                           << "[[bin]]\nid = 1\nname = \"" << name << "\"\n"
                           << "footprint_m = [[0, 0], [0.52, 0], [0.52, 0.355], [0, 0.355]]\nheight_m = 0.285\n"
                           << "schedule = { every = \"" << every_ << "\" }\n"
                           << "[bin.inventory]\nbook_mass_kg = 15.25\ndensity_kg_m3 = 790.0\n"
                           << "[bin.cycle]\nattempts = 1\n"
                           // The simulator's speckle is too fine for small pictures; their accuracy is no matter here.
                           << "[bin.surface]\nmin_coverage = 0.2\n"
                           << "[[bin.rig]]\nname = \"a\"\ncalibration = \"stereo.yml\"\npose = \"world.yml\"\n"
                           << "left = { driver = \"sim\" }\nright = { driver = \"sim\" }\n"
                           << "projector = { driver = \"sim\" }\n[bin.rig.sim]\nvolume_m3 = 0.019\n"
                           << sim;
  }
  std::vector<std::string> Arguments() const { return {"--config", config_.string()}; }
  std::optional<double> Read(int address, const std::string& type = "4") const {
    return ReadModbus(port_, address, type);
  }
  bool HasBit(int bit) const { return (static_cast<int>(Read(kStatusWord).value_or(0)) & bit) != 0; }

  TemporaryFolder folder_;
  std::filesystem::path config_ = folder_ / "granaryd.toml";
  std::uint16_t port_ = FreePort();
  std::string every_ = "1h";
};

TEST_F(Granaryd, ServesWhatItStored) {
  if (!HasMbpoll()) GTEST_SKIP() << "mbpoll is not installed";
  DaemonProcess daemon(folder_.path(), Arguments());
  ASSERT_TRUE(Eventually([&] { return HasBit(kValid); })) << daemon.Stdout() << daemon.Stderr();

  const auto stored = Store(folder_ / "state", Store::Access::kRead).LastGood(1);
  ASSERT_TRUE(stored);
  EXPECT_EQ(Read(kSequence), static_cast<double>(stored->sequence));
  EXPECT_NEAR(Read(kVolume, "4:float").value_or(NAN), *stored->volume_m3, kPrinted * *stored->volume_m3);
  EXPECT_NEAR(Read(kErrorRate, "4:float").value_or(NAN), *stored->error_rate_percent,
              kPrinted * std::abs(*stored->error_rate_percent));
  EXPECT_EQ(Read(kUtc, "4:int"), std::floor(std::chrono::duration<double>(stored->utc.time_since_epoch()).count()));
  EXPECT_EQ(Read(kReason), 0.0);
  EXPECT_TRUE(HasBit(kSimulated));
  EXPECT_FALSE(HasBit(kHeld));
}

TEST_F(Granaryd, LogsWhatItServes) {
  if (!HasMbpoll()) GTEST_SKIP() << "mbpoll is not installed";
  DaemonProcess daemon(folder_.path(), Arguments());
  const std::string mark = "bin 1 bay-1: ";
  ASSERT_TRUE(Eventually([&] { return daemon.Stdout().find(" m³ ±") != std::string::npos; })) << daemon.Stdout();
  const std::string log = daemon.Stdout();
  const double logged_m3 = std::strtod(log.c_str() + log.rfind(mark) + mark.size(), nullptr);
  // The log rounds to the first digit of the uncertainty, 0.0001 m³ here.
  EXPECT_NEAR(Read(kVolume, "4:float").value_or(NAN), logged_m3, 0.51e-4) << log;
}

TEST_F(Granaryd, BeatsWhileItWaits) {
  if (!HasMbpoll()) GTEST_SKIP() << "mbpoll is not installed";
  DaemonProcess daemon(folder_.path(), Arguments());
  EXPECT_TRUE(Eventually([&] { return HasBit(kValid) && Read(kHeartbeat).value_or(0) >= 3; })) << daemon.Stdout();
}

TEST_F(Granaryd, TellsSystemdHowItFares) {
  const FileDescriptor socket(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, (folder_ / "notify").c_str(), sizeof address.sun_path - 1);
  ASSERT_EQ(bind(socket.Get(), reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  std::string heard;
  const auto hears = [&](const std::string& words) {
    return Eventually([&] {
      std::array<char, 4096> message{};
      const auto size = recv(socket.Get(), message.data(), message.size(), 0);
      if (size > 0) heard.append(message.data(), static_cast<std::size_t>(size)).append("\n");
      return heard.find(words) != std::string::npos;
    });
  };

  DaemonProcess daemon(folder_.path(), Arguments());
  EXPECT_TRUE(hears("READY=1\n")) << heard;
  EXPECT_TRUE(hears("WATCHDOG=1\nSTATUS=bin 1 bay-1: ")) << heard;
  daemon.Signal(SIGTERM);
  EXPECT_TRUE(hears("STOPPING=1\n")) << heard;
}

TEST_F(Granaryd, EndsWithZeroOnSigterm) {
  DaemonProcess daemon(folder_.path(), Arguments());
  ASSERT_TRUE(Eventually([&] { return daemon.Stdout().find(" m³ ±") != std::string::npos; })) << daemon.Stdout();
  daemon.Signal(SIGTERM);
  EXPECT_EQ(daemon.ExitCode(), 0);
  EXPECT_NE(daemon.Stdout().find("ending on signal SIGTERM"), std::string::npos);
}

TEST_F(Granaryd, EndsWithZeroOnSigintDuringACycle) {
  DaemonProcess daemon(folder_.path(), Arguments());
  ASSERT_TRUE(Eventually([&] { return daemon.Stdout().find("Modbus TCP on") != std::string::npos; }));
  daemon.Signal(SIGINT);
  EXPECT_EQ(daemon.ExitCode(), 0) << daemon.Stderr();
}

TEST_F(Granaryd, KeepsTheOldConfigurationWhenTheNewOneIsBroken) {
  if (!HasMbpoll()) GTEST_SKIP() << "mbpoll is not installed";
  DaemonProcess daemon(folder_.path(), Arguments());
  ASSERT_TRUE(Eventually([&] { return HasBit(kValid); })) << daemon.Stdout();
  std::ofstream(config_, std::ios::app) << "\n[sight]\nname = \"typo\"\n";
  daemon.Signal(SIGHUP);
  ASSERT_TRUE(Eventually([&] { return daemon.Stdout().find("refused") != std::string::npos; })) << daemon.Stdout();
  EXPECT_NE(daemon.Stdout().find("sight"), std::string::npos);
  EXPECT_TRUE(daemon.Running());
  EXPECT_TRUE(HasBit(kValid));
}

TEST_F(Granaryd, KeepsTheOldConfigurationWhenACalibrationIsBroken) {
  if (!HasMbpoll()) GTEST_SKIP() << "mbpoll is not installed";
  DaemonProcess daemon(folder_.path(), Arguments());
  ASSERT_TRUE(Eventually([&] { return HasBit(kValid); })) << daemon.Stdout();
  folder_.Write("stereo.yml", "%YAML:1.0\n---\nimage_width: 640\n");
  daemon.Signal(SIGHUP);
  ASSERT_TRUE(Eventually([&] { return daemon.Stdout().find("refused") != std::string::npos; })) << daemon.Stdout();
  EXPECT_NE(daemon.Stdout().find("stereo.yml"), std::string::npos);
  EXPECT_TRUE(HasBit(kValid));
}

TEST_F(Granaryd, TakesANewConfigurationOnSighup) {
  if (!HasMbpoll()) GTEST_SKIP() << "mbpoll is not installed";
  DaemonProcess daemon(folder_.path(), Arguments());
  ASSERT_TRUE(Eventually([&] { return HasBit(kValid); })) << daemon.Stdout();
  Configure("bay-renamed");
  daemon.Signal(SIGHUP);
  EXPECT_TRUE(Eventually([&] { return Read(kSequence) == 2.0; })) << daemon.Stdout();
  EXPECT_NE(daemon.Stdout().find("bin 1 bay-renamed: 0.0"), std::string::npos) << daemon.Stdout();
}

TEST_F(Granaryd, HoldsTheLastFigureWhenTheProjectorDies) {
  if (!HasMbpoll()) GTEST_SKIP() << "mbpoll is not installed";
  {
    auto arguments = Arguments();
    arguments.insert(arguments.end(), {"--cycles", "1"});
    DaemonProcess daemon(folder_.path(), arguments);
    ASSERT_EQ(daemon.ExitCode(), 0) << daemon.Stdout();
  }
  const auto stored = Store(folder_ / "state", Store::Access::kRead).LastGood(1);
  Configure("bay-1", "projector_works = false\n");
  DaemonProcess daemon(folder_.path(), Arguments());
  ASSERT_TRUE(Eventually([&] { return Read(kReason).value_or(0) >= 10; })) << daemon.Stdout();
  EXPECT_TRUE(HasBit(kHeld));
  EXPECT_FALSE(HasBit(kValid));
  EXPECT_NEAR(Read(kVolume, "4:float").value_or(NAN), *stored->volume_m3, kPrinted * *stored->volume_m3);
  EXPECT_EQ(Read(kSequence), static_cast<double>(stored->sequence));
}

TEST_F(Granaryd, PrintsTheLastRecordAfterItsCycles) {
  every_ = "100ms";
  Configure();
  auto arguments = Arguments();
  arguments.insert(arguments.end(), {"--cycles", "2"});
  DaemonProcess daemon(folder_.path(), arguments);
  EXPECT_EQ(daemon.ExitCode(), 0) << daemon.Stderr();
  const std::string out = daemon.Stdout();
  const auto last_line = out.rfind('\n', out.size() - 2) + 1;
  const Measurement record = RecordFromJson(nlohmann::ordered_json::parse(out.substr(last_line)));
  EXPECT_EQ(record.sequence, 2U);
  EXPECT_TRUE(record.valid);
}

TEST_F(Granaryd, NamesTheAddressThatIsInUse) {
  const FileDescriptor taken = ListenTcp("127.0.0.1", port_);
  DaemonProcess daemon(folder_.path(), Arguments());
  EXPECT_EQ(daemon.ExitCode(), 1);
  const std::string words = daemon.Stderr();
  EXPECT_NE(words.find("127.0.0.1:" + std::to_string(port_)), std::string::npos) << words;
  EXPECT_EQ(std::count(words.begin(), words.end(), '\n'), 1) << words;
}

TEST_F(Granaryd, ExitsWith78OnABadConfiguration) {
  folder_.Write("granaryd.toml", "[[bin]]\nid = 0\n");
  DaemonProcess daemon(folder_.path(), Arguments());
  EXPECT_EQ(daemon.ExitCode(), 78);
  EXPECT_NE(daemon.Stderr().find("granaryd.toml:2: "), std::string::npos) << daemon.Stderr();
}

TEST_F(Granaryd, ChecksAConfigurationWithoutRunning) {
  auto arguments = Arguments();
  arguments.emplace_back("--check-config");
  {
    DaemonProcess good(folder_.path(), arguments);
    EXPECT_EQ(good.ExitCode(), 0) << good.Stdout();
  }
  folder_.Write("granaryd.toml", "[[bin]]\nid = 0\n");
  DaemonProcess bad(folder_.path(), arguments);
  EXPECT_EQ(bad.ExitCode(), 1);
  EXPECT_NE(bad.Stdout().find("granaryd.toml:2: "), std::string::npos) << bad.Stdout();
}

TEST_F(Granaryd, NamesTheCalibrationThatIsMissing) {
  std::filesystem::remove(folder_ / "stereo.yml");
  DaemonProcess daemon(folder_.path(), Arguments());
  const auto code = daemon.ExitCode();
  EXPECT_TRUE(code == 1 || code == 78) << daemon.Stdout();
  EXPECT_NE(daemon.Stderr().find("stereo.yml"), std::string::npos) << daemon.Stderr();
}

TEST_F(Granaryd, MeasuresOnWhenItsStateFolderCannotBe) {
  if (!HasMbpoll()) GTEST_SKIP() << "mbpoll is not installed";
  folder_.Write("state", "a file where a folder should be");
  DaemonProcess daemon(folder_.path(), Arguments());
  EXPECT_TRUE(Eventually([&] { return HasBit(kValid); })) << daemon.Stdout() << daemon.Stderr();
  EXPECT_NE(daemon.Stdout().find("RECORDS ARE NOT BEING KEPT"), std::string::npos) << daemon.Stdout();
}

TEST_F(Granaryd, CallsBadUsageTwo) {
  DaemonProcess daemon(folder_.path(), {"--frobnicate"});
  EXPECT_EQ(daemon.ExitCode(), 2);
}

}  // namespace
}  // namespace granary
