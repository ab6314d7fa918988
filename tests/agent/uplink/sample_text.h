// A sample as published, after the conversion to a row and back.
#pragma once

#include <gtest/gtest.h>

#include "agent/uplink/payload/json_payload.h"
#include "tests/agent/uplink/plant.h"

namespace fxagent::test {

inline std::string sample_text(const Telemetry& message, std::string_view boot = "9f3c21aa",
                               std::string_view meta = "a41c") {
  const std::string row = encode_sample(message, press("press1"), boot, meta);
  SampleRecord record;
  EXPECT_TRUE(decode_sample(row, record));
  return fxagent::json::sample(record);
}

}  // namespace fxagent::test
