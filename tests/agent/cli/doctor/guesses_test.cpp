#include "agent/cli/doctor/guesses.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

TEST(Guesses, OwnLineComesFirstThenItsOtherParities) {
  const auto& rtu = *find_protocol("modbus-rtu");
  const LineDefaults own{19200, 8, Parity::none, 1};
  const auto guesses = line_guesses(rtu, own);
  ASSERT_GE(guesses.size(), 3U);
  EXPECT_TRUE(guesses[0] == own);
  EXPECT_TRUE(guesses[1] == (LineDefaults{19200, 8, Parity::even, 1}));
  EXPECT_TRUE(guesses[2] == (LineDefaults{19200, 8, Parity::odd, 1}));
}

TEST(Guesses, EachLineOccursOnce) {
  for (const ProtocolInfo& protocol : catalog()) {
    const auto guesses = line_guesses(protocol, protocol.line);
    for (std::size_t i = 0; i < guesses.size(); ++i)
      for (std::size_t j = 0; j < i; ++j) EXPECT_FALSE(guesses[i] == guesses[j]) << protocol.name;
  }
}

TEST(Guesses, ModbusRtuAlwaysHasEightDataBits) {
  for (const LineDefaults& guess : line_guesses(*find_protocol("modbus-rtu"), {}))
    EXPECT_TRUE(guess.data_bits == 8 || guess == LineDefaults{});
}

TEST(Guesses, OwnStationComesFirstAndABroadcastNever) {
  const auto units = station_guesses(*find_protocol("modbus-rtu"), 7);
  EXPECT_EQ(units.size(), 247U);
  EXPECT_EQ(units[0], 7);
  EXPECT_EQ(units[1], 1);
  EXPECT_EQ(station_guesses(*find_protocol("fx-computer-link"), 3).size(), 16U);
}

TEST(Guesses, ModbusTcpTriesTheUnitsOfADeviceWithoutABusFirst) {
  const auto units = station_guesses(*find_protocol("modbus-tcp"), 9);
  ASSERT_GE(units.size(), 4U);
  EXPECT_EQ(std::vector<std::int64_t>(units.begin(), units.begin() + 4),
            (std::vector<std::int64_t>{9, 255, 1, 0}));
}

}  // namespace
}  // namespace fxagent
