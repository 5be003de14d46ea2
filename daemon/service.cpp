// One loop on the main thread: signals, a wake-up from the workers, and a tick each second that carries the proof of
// life from the workers to the heartbeat and to systemd.
#include "daemon/service.h"

#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <system_error>
#include <utility>

#include "daemon/inherited_sockets.h"
#include "daemon/local_commands.h"
#include "daemon/log.h"
#include "daemon/modbus/front.h"
#include "daemon/systemd.h"
#include "daemon/worker.h"

namespace granary {
namespace {

sigset_t OurSignals() {
  sigset_t set;
  sigemptyset(&set);
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&set, signal);
  return set;
}

/// Hands what clients ask to the bin they mean.
class BinSwitchboard : public BinControl {
 public:
  /// Before any server starts.
  void Add(BinMonitor& monitor) { monitors_.push_back(&monitor); }
  bool Ask(int bin, BinCommand command, const std::string& who) override {
    return With(bin, [&](BinMonitor& monitor) { return monitor.Ask(command, who); });
  }
  bool CommitBook(int bin, const BookData& book, const std::string& who) override {
    return With(bin, [&](BinMonitor& monitor) { return monitor.CommitBook(book, who); });
  }
  bool SetFormat(int bin, const RegisterFormat& format, const std::string& who) override {
    return With(bin, [&](BinMonitor& monitor) { return monitor.SetFormat(format, who); });
  }

 private:
  bool With(int bin, const std::function<bool(BinMonitor&)>& ask) const {
    const auto found = std::find_if(monitors_.begin(), monitors_.end(),
                                    [&](const BinMonitor* monitor) { return monitor->setup().bin.id == bin; });
    return found != monitors_.end() && ask(**found);
  }

  std::vector<BinMonitor*> monitors_;
};

/// Empty for none.
FileDescriptor Copy(const FileDescriptor& descriptor) {
  return descriptor.Get() < 0 ? FileDescriptor() : Checked(dup(descriptor.Get()), "dup");
}

bool SameListener(const ModbusTcpOptions& a, const ModbusTcpOptions& b) { return a.host == b.host && a.port == b.port; }

}  // namespace

void BlockSignals() {
  const sigset_t set = OurSignals();
  if (pthread_sigmask(SIG_BLOCK, &set, nullptr) != 0)
    throw std::system_error(errno, std::generic_category(), "sigmask");
}

/// One configuration at work. The order matters: the servers end before the bins that they ask, and these are stopped
/// before the units that they publish to go.
struct Service::Running {
  std::string log_level;
  ModbusOptions modbus;
  FileDescriptor tcp, tls;
  BinSwitchboard control;
  std::vector<std::unique_ptr<Worker>> workers;
  std::unique_ptr<ModbusFront> front;

  ~Running() { Stop(); }
  void Stop() {
    for (auto& worker : workers) worker->RequestStop();
    for (auto& worker : workers) worker->Stop();
  }
  [[nodiscard]] Worker* Find(int bin) const {
    const auto found = std::find_if(workers.begin(), workers.end(),
                                    [&](const auto& worker) { return worker->monitor().setup().bin.id == bin; });
    return found == workers.end() ? nullptr : found->get();
  }
  [[nodiscard]] std::vector<BinMonitor*> Monitors() const {
    std::vector<BinMonitor*> monitors;
    for (const auto& worker : workers) monitors.push_back(&worker->monitor());
    return monitors;
  }
};

Service::Service(ServiceOptions options, Records& records, Clock& clock, RigOpener open)
    : options_(std::move(options)), records_(records), clock_(clock), open_(std::move(open)) {
  const sigset_t set = OurSignals();
  signals_ = Checked(signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK), "signalfd");
  wake_ = Checked(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK), "eventfd");
}

Service::~Service() = default;

std::unique_ptr<Service::Running> Service::Build(const Running* before) {
  const ServicePlan plan = options_.load();
  auto next = std::make_unique<Running>();
  next->log_level = plan.log_level;
  next->modbus = plan.modbus;
  // The address first: it is the quickest to be refused. An address that stays keeps its socket, so that no client
  // meets a closed door between two configurations.
  const auto listener = [&](const ModbusTcpOptions& wanted, const ModbusTcpOptions* old, const FileDescriptor* held) {
    return old != nullptr && SameListener(*old, wanted) ? Copy(*held)
                                                        : TakeListener(options_.listeners, wanted.host, wanted.port);
  };
  next->tcp = listener(plan.modbus.tcp, before ? &before->modbus.tcp : nullptr, before ? &before->tcp : nullptr);
  if (plan.modbus.tls) {
    const bool had = before != nullptr && before->modbus.tls;
    next->tls = listener(plan.modbus.tls->tcp, had ? &before->modbus.tls->tcp : nullptr, had ? &before->tls : nullptr);
  }
  std::vector<HostPort> end_points{{plan.modbus.tcp.host, plan.modbus.tcp.port}};
  if (plan.modbus.tls) end_points.push_back({plan.modbus.tls->tcp.host, plan.modbus.tls->tcp.port});
  RequireAllServed(options_.listeners, end_points);

  std::vector<BinSetup> setups = plan.assemble();
  std::vector<Bin> bins;
  for (const auto& setup : setups) bins.push_back(setup.bin);
  ModbusIdentity identity;
  identity.version = options_.version;
  identity.site = plan.site_name;
  identity.serial = static_cast<std::uint32_t>(plan.modbus.serial);
  next->front = std::make_unique<ModbusFront>(plan.modbus, std::move(identity), bins, next->control);
  const auto wake = [descriptor = wake_.Get()] {
    const std::uint64_t one = 1;
    // Only fails when the counter is full, and then the loop is awake already.
    [[maybe_unused]] const auto written = write(descriptor, &one, sizeof one);
  };
  for (auto& setup : setups) {
    next->workers.push_back(
        std::make_unique<Worker>(std::move(setup), records_, next->front->Publishers(), clock_, open_, wake));
    next->control.Add(next->workers.back()->monitor());
  }
  if (before == nullptr) {
    // Held figures are served while references are still being read.
    for (auto& worker : next->workers) worker->monitor().Restore();
    next->front->Listen(Copy(next->tcp), Copy(next->tls));
  }
  for (auto& worker : next->workers) worker->monitor().Prepare();
  return next;
}

void Service::Begin(Running& next, Running* before) {
  SetLogLevel(next.log_level);
  for (auto& worker : next.workers) {
    Worker* const old = before == nullptr ? nullptr : before->Find(worker->monitor().setup().bin.id);
    if (before != nullptr) {
      worker->monitor().Restore(old == nullptr ? std::nullopt : std::optional(old->monitor().Snapshot()));
    }
    worker->Start(options_.cycles);
  }
  if (before != nullptr) before->front->CloseLine();
  next.front->OpenLine();
  spdlog::info("Modbus TCP on {}, records and references in {}",
               PrintHostPort({next.modbus.tcp.host, next.front->Port()}), records_.folder().string());
  for (const auto& worker : next.workers) {
    const BinSetup& setup = worker->monitor().setup();
    spdlog::info("unit {}: {}{}", setup.bin.id, setup.bin.name, setup.simulated ? " (SIMULATED)" : "");
  }
}

void Service::OpenControlSocket() {
  const auto answer = [this](const nlohmann::json& request, const std::string& who) {
    const std::scoped_lock lock(swap_);
    return AnswerLocal(request, who, running_->Monitors());
  };
  try {
    control_socket_ = std::make_unique<ControlSocket>(ControlFolder(records_.folder()), answer);
  } catch (const std::runtime_error& error) {
    spdlog::error("granaryctl cannot reach this daemon: {}", error.what());
  }
}

void Service::BeginReload() {
  if (reloading_.valid()) {
    reload_again_ = true;
    return;
  }
  NotifySystemd(ReloadingState());
  // On a thread of its own: reading and building take seconds, in which the watchdog wants its food.
  reloading_ = std::async(std::launch::async, [this] {
    auto next = Build(running_.get());
    // Clients that meet the new server while the old workers end see the last figures, not "no measurement yet".
    for (const auto& snapshot : Snapshots()) {
      if (next->Find(snapshot.bin.id) != nullptr) next->front->units().Publish(snapshot);
    }
    next->front->Listen(Copy(next->tcp), Copy(next->tls));
    running_->Stop();
    return next;
  });
}

void Service::EndReload() {
  try {
    auto next = reloading_.get();
    Begin(*next, running_.get());
    {
      const std::scoped_lock lock(swap_);
      running_.swap(next);
    }
    spdlog::info("the configuration was read anew and is in force");
  } catch (const std::exception& error) {
    spdlog::error("the configuration was read anew and refused, the old one stays in force:\n{}", error.what());
  }
  NotifySystemd("READY=1");
  if (std::exchange(reload_again_, false)) BeginReload();
}

std::vector<BinSnapshot> Service::Snapshots() const {
  std::vector<BinSnapshot> snapshots;
  for (const auto& worker : running_->workers) snapshots.push_back(worker->monitor().Snapshot());
  return snapshots;
}

void Service::Tick() {
  bool progress = true;
  for (const auto& worker : running_->workers) progress = worker->monitor().Supervise() && progress;
  if (progress != progress_) {
    if (progress) {
      spdlog::warn("every worker makes progress again");
    } else {
      spdlog::critical("a worker makes no progress: the watchdog is not fed any more");
    }
    progress_ = progress;
  }
  NotifySystemd(TickState(progress, Snapshots()));
}

std::vector<BinSnapshot> Service::Run() {
  using std::chrono::milliseconds;
  running_ = Build(nullptr);
  Begin(*running_, nullptr);
  OpenControlSocket();
  NotifySystemd("READY=1\nSTATUS=" + StatusText(Snapshots()));

  constexpr std::chrono::seconds kTick{1};
  auto next_tick = clock_.Steady() + kTick;
  for (bool ending = false; !ending;) {
    const auto left = std::chrono::ceil<milliseconds>(next_tick - clock_.Steady());
    std::array<pollfd, 2> polled{{{signals_.Get(), POLLIN, 0}, {wake_.Get(), POLLIN, 0}}};
    if (poll(polled.data(), polled.size(), static_cast<int>(std::max<std::int64_t>(0, left.count()))) < 0 &&
        errno != EINTR) {
      throw std::system_error(errno, std::generic_category(), "poll");
    }
    std::uint64_t wakes = 0;
    [[maybe_unused]] const auto drained = read(wake_.Get(), &wakes, sizeof wakes);  // nothing there: EAGAIN
    signalfd_siginfo signal{};
    while (!ending && read(signals_.Get(), &signal, sizeof signal) == static_cast<ssize_t>(sizeof signal)) {
      if (signal.ssi_signo == SIGHUP) {
        BeginReload();
      } else {
        spdlog::info("ending on signal {}", signal.ssi_signo == SIGTERM ? "SIGTERM" : "SIGINT");
        ending = true;
      }
    }
    if (!ending && reloading_.valid() && reloading_.wait_for(milliseconds{0}) == std::future_status::ready) EndReload();
    const auto& workers = running_->workers;
    ending = ending || std::all_of(workers.begin(), workers.end(), [](const auto& worker) { return worker->Done(); });
    if (!ending && clock_.Steady() >= next_tick) {
      Tick();
      // After a stall the missed ticks are not made up for: the heartbeat counts seconds of life.
      next_tick = std::max(next_tick + kTick, clock_.Steady());
    }
  }
  NotifySystemd("STOPPING=1\nSTATUS=ending");
  if (reloading_.valid()) reloading_.wait();  // it may be stopping the same workers
  running_->Stop();
  std::vector<BinSnapshot> last = Snapshots();
  control_socket_.reset();
  running_.reset();
  return last;
}

}  // namespace granary
