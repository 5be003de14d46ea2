// One place that knows which servers there are; each of them knows only the units.
#include "daemon/modbus/front.h"

#include <utility>

namespace granary {

ModbusFront::ModbusFront(const ModbusOptions& options, ModbusIdentity identity, const std::vector<Bin>& bins,
                         BinControl& control)
    : options_(options), units_(identity, bins, control, tally_) {
  if (options_.tls) tls_context_ = LoadTls(*options_.tls);
  if (options_.plc) plc_ = std::make_unique<PlcClient>(*options_.plc, bins, std::move(identity), control, tally_);
}

std::vector<Publisher*> ModbusFront::Publishers() {
  if (!plc_) return {&units_};
  return {&units_, plc_.get()};
}

void ModbusFront::Listen(FileDescriptor tcp, FileDescriptor tls) {
  tcp_ = std::make_unique<ModbusServer>(std::move(tcp), options_.tcp, units_, tally_);
  if (options_.tls) {
    tls_ =
        std::make_unique<ModbusServer>(std::move(tls), options_.tls->tcp, units_, tally_, ModbusLimits{}, tls_context_);
  }
}

void ModbusFront::OpenLine() {
  // A missing adapter must not keep the bins from being measured and served over TCP.
  if (options_.rtu) {
    rtu_ = std::make_unique<RtuServer>(*options_.rtu, units_, tally_, RtuReopening{.wait_for_port = true});
  }
}

}  // namespace granary
