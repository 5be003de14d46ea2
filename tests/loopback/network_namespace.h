// A network of the test's own, where it may add addresses and listen on any port.
#pragma once

#include <string>

namespace granary {

/// Moves this process, and what it starts from here on, into a user and a network namespace whose only interface has
/// the addresses 127.0.0.1 and 127.0.0.2. To be called before there is a second thread; again, it changes nothing.
/// @return why it cannot be, for GTEST_SKIP; empty when it is done
std::string EnterNetworkNamespace();

}  // namespace granary
