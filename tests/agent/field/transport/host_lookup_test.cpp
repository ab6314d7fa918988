#include "agent/field/transport/host_lookup.h"

#include <gtest/gtest.h>

namespace fxagent::test {
namespace {

TEST(SocketFault, NamesWhatToCheck) {
  for (const auto& [error, cure] : {std::pair{asio::error::host_unreachable, "network up"},
                                    std::pair{asio::error::network_unreachable, "network up"},
                                    std::pair{asio::error::no_descriptors, "LimitNOFILE"}}) {
    const std::string why = why_failed(error);
    EXPECT_NE(why.find(cure), std::string::npos) << why;
  }
}

}  // namespace
}  // namespace fxagent::test
