// What a SCADA system, a PLC and an engineer do to a running daemon, and what of it survives a SIGKILL.
#include <fcntl.h>
#include <modbus/modbus.h>
#include <sys/socket.h>

#include <array>
#include <atomic>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "daemon/control_socket.h"
#include "daemon/modbus/rtu_frame.h"
#include "daemon/modbus/socket.h"
#include "daemon/store.h"
#include "tests/daemon/modbus/rtu_line.h"
#include "tests/loopback/daemon_process.h"
#include "tests/loopback/half_size_rig.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {
namespace {

using ::testing::HasSubstr;

constexpr int kStatus = 0, kSequence = 5, kVolume = 10, kBook = 34, kWritesRefused = 254;
constexpr int kFormat = 900, kCommand = 910, kEcho = 911, kResult = 912, kBookData = 920, kCommit = 930;
constexpr int kValid = 1 << 0, kHeld = 1 << 1, kSimulated = 1 << 4, kMaintenance = 1 << 5;
constexpr int kMeasure = 1, kInhibit = 3, kRelease = 4, kDone = 2;

/// libmodbus as the master; connects anew for every request, as the daemon may have been restarted.
class Master {
 public:
  explicit Master(std::uint16_t port) : port_(port) {}

  std::optional<std::vector<std::uint16_t>> Read(int address, int count) const {
    std::vector<std::uint16_t> words(static_cast<std::size_t>(count));
    const auto master = Connected();
    if (!master || modbus_read_registers(master.get(), address, count, words.data()) != count) return std::nullopt;
    return words;
  }
  int Word(int address) const {
    const auto words = Read(address, 1);
    return words ? words->front() : -1;
  }
  double Float(int address) const {
    const auto words = Read(address, 2);
    return words ? std::bit_cast<float>((std::uint32_t{(*words)[0]} << 16) | (*words)[1]) : std::nan("");
  }
  bool HasStatus(int bit) const { return Word(kStatus) >= 0 && (Word(kStatus) & bit) != 0; }
  /// 0, or the errno of libmodbus: EMBXILFUN and so on.
  int Write(int address, const std::vector<std::uint16_t>& words) const {
    const auto master = Connected();
    if (!master) return ENOTCONN;
    const int count = static_cast<int>(words.size());
    return modbus_write_registers(master.get(), address, count, words.data()) == count ? 0 : errno;
  }

 private:
  std::unique_ptr<modbus_t, void (*)(modbus_t*)> Connected() const {
    std::unique_ptr<modbus_t, void (*)(modbus_t*)> master(modbus_new_tcp("127.0.0.1", port_), [](modbus_t* context) {
      modbus_close(context);
      modbus_free(context);
    });
    modbus_set_slave(master.get(), 1);
    modbus_set_response_timeout(master.get(), 10, 0);
    if (modbus_connect(master.get()) != 0) master.reset();
    return master;
  }

  std::uint16_t port_;
};

std::vector<std::uint16_t> WordsOf(const std::vector<float>& values) {
  std::vector<std::uint16_t> words;
  for (const float value : values) {
    const auto bits = std::bit_cast<std::uint32_t>(value);
    words.push_back(static_cast<std::uint16_t>(bits >> 16));
    words.push_back(static_cast<std::uint16_t>(bits));
  }
  return words;
}

/// Book quantity in t, density, correction, loss in t, and the commit, as one write of 11 registers.
std::vector<std::uint16_t> BookBlock(float book_t, float density_kg_m3) {
  auto words = WordsOf({book_t, density_kg_m3, 1.0F, 0.0F});
  words.insert(words.end(), {0, 0, 1});
  return words;
}

class GranarydModbus : public testing::Test {
 protected:
  void SetUp() override { WriteHalfSizeRig(folder_.path()); }

  void Configure(const std::string& modbus, const std::string& sim = "") {
    std::ofstream(config_) << "[modbus.tcp]\nlisten = \"127.0.0.1:" << port_ << "\"\n"
                           << modbus << "[[bin]]\nid = 1\nname = \"bay-1\"\n"
                           << "footprint_m = [[0, 0], [0.52, 0], [0.52, 0.355], [0, 0.355]]\nheight_m = 0.285\n"
                           << "schedule = { every = \"1h\" }\n"
                           << "[bin.inventory]\nbook_mass_kg = 15.25\ndensity_kg_m3 = 790.0\n"
                           << "[bin.cycle]\nattempts = 1\n[bin.surface]\nmin_coverage = 0.2\n"
                           << "[[bin.rig]]\nname = \"a\"\ncalibration = \"stereo.yml\"\npose = \"world.yml\"\n"
                           << "left = { driver = \"sim\" }\nright = { driver = \"sim\" }\n"
                           << "projector = { driver = \"sim\" }\n[bin.rig.sim]\nvolume_m3 = 0.019\n"
                           << sim;
  }
  void Start(int listener = -1) {
    daemon_.reset();
    daemon_ = std::make_unique<DaemonProcess>(folder_.path(), std::vector<std::string>{"--config", config_.string()},
                                              listener);
  }
  void StartAndMeasure() {
    Start();
    ASSERT_TRUE(Eventually([this] { return master_.HasStatus(kValid); })) << daemon_->Stdout() << daemon_->Stderr();
  }
  void KillAndStart() {
    daemon_->Signal(SIGKILL);
    ASSERT_TRUE(Eventually([this] { return !daemon_->Running(); }));
    Start();
  }
  bool EndsWith(int command, int result) const {
    return Eventually([&] { return master_.Word(kEcho) == command && master_.Word(kResult) == result; });
  }

  TemporaryFolder folder_;
  std::filesystem::path config_ = folder_ / "granaryd.toml";
  std::uint16_t port_ = FreePort();
  Master master_{port_};
  std::unique_ptr<DaemonProcess> daemon_;
};

const std::string kMayWrite = "write_allow = [\"127.0.0.0/8\"]\n";

TEST_F(GranarydModbus, ServesTheHeldFigureAfterAKill) {
  Configure("");
  StartAndMeasure();
  const auto before = master_.Read(0, 65);
  ASSERT_TRUE(before);
  Configure("", "projector_works = false\n");  // so that nothing new can be measured
  KillAndStart();
  ASSERT_TRUE(Eventually([this] { return master_.HasStatus(kHeld); })) << daemon_->Stdout();
  const auto after = master_.Read(0, 65);
  ASSERT_TRUE(after);
  for (const int address : {kSequence, 6, 7, kVolume, kVolume + 1}) EXPECT_EQ((*after)[address], (*before)[address]);
  EXPECT_FALSE((*after)[kStatus] & kValid);
}

TEST_F(GranarydModbus, RefusesAWriteFromWhereNobodyMayWrite) {
  Configure("");
  StartAndMeasure();
  EXPECT_EQ(master_.Write(kFormat, {1}), EMBXILFUN);
  EXPECT_EQ(master_.Write(kBookData, BookBlock(20, 800)), EMBXILFUN);
  EXPECT_EQ(master_.Word(kFormat), 0);
  EXPECT_EQ(master_.Word(kWritesRefused + 1), 2);
  EXPECT_THAT(daemon_->Stdout(), HasSubstr("127.0.0.1"));
  EXPECT_THAT(daemon_->Stdout(), HasSubstr("write_allow"));
}

TEST_F(GranarydModbus, MeasuresOnCommand) {
  Configure(kMayWrite);
  StartAndMeasure();
  const int before = master_.Word(kSequence);
  EXPECT_EQ(master_.Write(kCommand, {kMeasure}), 0);
  EXPECT_TRUE(EndsWith(kMeasure, kDone));
  EXPECT_EQ(master_.Word(kSequence), before + 1);
  EXPECT_EQ(master_.Write(kCommand, {0}), 0);
  EXPECT_EQ(master_.Word(kResult), 0);
}

TEST_F(GranarydModbus, ComparesWithTheBookDataCommittedAlsoAfterAKill) {
  Configure(kMayWrite);
  StartAndMeasure();
  EXPECT_NEAR(master_.Float(kBook), 0.01525, 1e-7);
  EXPECT_EQ(master_.Write(kBookData, BookBlock(0.0160F, 780)), 0);
  ASSERT_TRUE(Eventually([this] { return master_.Word(kCommit) == kDone; })) << daemon_->Stdout();
  EXPECT_NEAR(master_.Float(kBook), 0.01525, 1e-7) << "the published measurement keeps the books it was compared with";

  KillAndStart();
  ASSERT_TRUE(Eventually([this] { return master_.HasStatus(kValid); })) << daemon_->Stdout();
  EXPECT_NEAR(master_.Float(kBook), 0.0160, 1e-7);
  EXPECT_EQ(master_.Float(28), 780.0);
}

TEST_F(GranarydModbus, RefusesBookDataOutOfRangeWhole) {
  Configure(kMayWrite);
  StartAndMeasure();
  EXPECT_EQ(master_.Write(kBookData, BookBlock(0.0160F, -1)), EMBXILVAL);
  EXPECT_NEAR(master_.Float(kBookData), 0.01525, 1e-7);
  EXPECT_EQ(master_.Float(kBookData + 2), 790.0);
}

TEST_F(GranarydModbus, StaysInhibitedOverAKill) {
  Configure(kMayWrite);
  StartAndMeasure();
  EXPECT_EQ(master_.Write(kCommand, {kInhibit}), 0);
  ASSERT_TRUE(EndsWith(kInhibit, kDone));
  EXPECT_TRUE(master_.HasStatus(kMaintenance));

  KillAndStart();
  ASSERT_TRUE(Eventually([this] { return master_.HasStatus(kMaintenance); })) << daemon_->Stdout();
  EXPECT_FALSE(master_.HasStatus(kValid));
  EXPECT_EQ(master_.Write(kCommand, {kRelease}), 0);
  ASSERT_TRUE(EndsWith(kRelease, kDone));
  EXPECT_FALSE(master_.HasStatus(kMaintenance));
}

TEST_F(GranarydModbus, KeepsTheByteOrderChosenOverAKill) {
  Configure(kMayWrite);
  StartAndMeasure();
  const double volume = master_.Float(kVolume);
  EXPECT_EQ(master_.Write(kFormat, {1}), 0);
  // It is in force at once, and on disk a moment later.
  ASSERT_TRUE(Eventually([this] {
    return Store(folder_ / "state", Store::Access::kRead).State(1).value_or(BinState{}).format.has_value();
  }));
  KillAndStart();
  ASSERT_TRUE(Eventually([this] { return master_.HasStatus(kValid); }));
  const auto words = master_.Read(kVolume, 2);
  ASSERT_TRUE(words);
  EXPECT_EQ(std::bit_cast<float>((std::uint32_t{(*words)[1]} << 16) | (*words)[0]), static_cast<float>(volume));
  EXPECT_EQ(master_.Float(2000 + kVolume), volume);
}

TEST_F(GranarydModbus, TakesTheSocketThatSystemdOpened) {
  Configure("");
  const FileDescriptor listener = ListenTcp("127.0.0.1", port_);
  Start(listener.Get());
  EXPECT_TRUE(Eventually([this] { return master_.HasStatus(kValid); })) << daemon_->Stdout() << daemon_->Stderr();
}

TEST_F(GranarydModbus, RefusesASocketThatNoKeyNames) {
  Configure("");
  const FileDescriptor listener = ListenTcp("127.0.0.1", 0);
  Start(listener.Get());
  EXPECT_EQ(daemon_->ExitCode(), 1);
  EXPECT_THAT(daemon_->Stderr(), HasSubstr(std::to_string(BoundPort(listener.Get()))));
}

TEST_F(GranarydModbus, ShowsAnInjectedFigureAsSimulatedAndThenTheTruth) {
  Configure("");
  StartAndMeasure();
  const double volume = master_.Float(kVolume);
  const auto ask = [this](int seconds) {
    return AskDaemon(folder_ / "state",
                     {{"command", "inject"}, {"bin", 1}, {"seconds", seconds}, {"volume_m3", 0.0123}});
  };
  EXPECT_TRUE(ask(600).value("ok", false));
  EXPECT_NEAR(master_.Float(kVolume), 0.0123, 1e-8);
  EXPECT_TRUE(master_.HasStatus(kSimulated));
  EXPECT_TRUE(ask(0).value("ok", false));
  EXPECT_EQ(master_.Float(kVolume), volume);
}

/// A PLC of libmodbus: one client, registers 0–199.
class Plc {
 public:
  Plc() {
    modbus_set_slave(context_.get(), 1);
    thread_ = std::jthread([this](const std::stop_token& stop) { Serve(stop); });
  }
  ~Plc() {
    thread_.request_stop();
    shutdown(listener_.Get(), SHUT_RDWR);
    const int client = client_;
    if (client >= 0) shutdown(client, SHUT_RDWR);
  }
  [[nodiscard]] std::uint16_t Port() const { return BoundPort(listener_.Get()); }
  [[nodiscard]] int Word(int address) const { return words_.at(static_cast<std::size_t>(address)); }

 private:
  void Serve(const std::stop_token& stop) {
    const std::unique_ptr<modbus_mapping_t, void (*)(modbus_mapping_t*)> map(modbus_mapping_new(0, 0, 200, 0),
                                                                             &modbus_mapping_free);
    while (!stop.stop_requested()) {
      int listening = listener_.Get();
      client_ = modbus_tcp_accept(context_.get(), &listening);
      if (client_ < 0) return;
      std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> request;
      for (int size = 0; (size = modbus_receive(context_.get(), request.data())) >= 0;) {
        if (size == 0) continue;
        modbus_reply(context_.get(), request.data(), size, map.get());
        for (std::size_t i = 0; i < words_.size(); ++i) words_[i] = map->tab_registers[i];
      }
      modbus_close(context_.get());
    }
  }

  std::unique_ptr<modbus_t, void (*)(modbus_t*)> context_{modbus_new_tcp("127.0.0.1", 1502), &modbus_free};
  // Blocking, unlike the server's own.
  FileDescriptor listener_ = Blocking();
  std::atomic<int> client_ = -1;
  std::array<std::atomic<int>, 200> words_{};
  std::jthread thread_;

  static FileDescriptor Blocking() {
    FileDescriptor listener = ListenTcp("127.0.0.1", 0);
    fcntl(listener.Get(), F_SETFL, fcntl(listener.Get(), F_GETFL) & ~O_NONBLOCK);
    return listener;
  }
};

TEST_F(GranarydModbus, PushesItsFiguresToThePlc) {
  const Plc plc;
  Configure("[modbus.plc]\naddress = \"127.0.0.1:" + std::to_string(plc.Port()) + "\"\nbase = 100\n");
  StartAndMeasure();
  EXPECT_TRUE(Eventually([&] {
    return (plc.Word(100 + kStatus) & kValid) != 0 && plc.Word(100 + kSequence) == plc.Word(164) &&
           plc.Word(100 + kVolume) == master_.Word(kVolume);
  })) << daemon_->Stdout();
}

TEST_F(GranarydModbus, ServesItsBinsWhileThePlcIsDead) {
  const FileDescriptor deaf = ListenTcp("127.0.0.1", 0);  // connects, but nobody ever answers
  Configure("[modbus.plc]\naddress = \"127.0.0.1:" + std::to_string(BoundPort(deaf.Get())) + "\"\n");
  StartAndMeasure();
  EXPECT_TRUE(Eventually([&] { return master_.Word(267) + master_.Word(269) + master_.Word(271) > 0; }));
  EXPECT_TRUE(master_.HasStatus(kValid));
}

TEST_F(GranarydModbus, ServesTheSerialLine) {
  const test::Pty line;
  Configure("[modbus.rtu]\ndevice = \"" + line.Path() + "\"\n");
  StartAndMeasure();
  line.Send(RtuFrame(1, std::array<std::uint8_t, 5>{3, 0, kSequence, 0, 1}));
  const auto sequence = static_cast<std::uint8_t>(master_.Word(kSequence));
  EXPECT_EQ(line.Receive(7), RtuFrame(1, std::array<std::uint8_t, 4>{3, 2, 0, sequence}));
}

TEST_F(GranarydModbus, MeasuresWithoutTheSerialPortThatIsMissing) {
  Configure("[modbus.rtu]\ndevice = \"/dev/no-such-port\"\n");
  StartAndMeasure();
  EXPECT_THAT(daemon_->Stdout(), HasSubstr("/dev/no-such-port"));
}

TEST_F(GranarydModbus, ChecksTheFieldsForThePlc) {
  Configure("[modbus.plc]\naddress = \"127.0.0.1:5020\"\nfields = [\"volume\", \"volumes\"]\n");
  daemon_ = std::make_unique<DaemonProcess>(folder_.path(),
                                            std::vector<std::string>{"--config", config_.string(), "--check-config"});
  EXPECT_EQ(daemon_->ExitCode(), 1);
  EXPECT_THAT(daemon_->Stdout(), HasSubstr(config_.string() + ":5: modbus.plc.fields"));
  EXPECT_THAT(daemon_->Stdout(), HasSubstr("volumes"));
}

}  // namespace
}  // namespace granary
