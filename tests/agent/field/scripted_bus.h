// A bus on a line whose far end is a script; for the tests of what sends over a bus.
#pragma once

#include <gtest/gtest.h>

#include <asio/io_context.hpp>
#include <chrono>

#include "agent/field/bus/bus.h"
#include "agent/field/command/command_exchanges.h"
#include "tests/agent/field/on_io.h"
#include "tests/support/scripted_transport.h"

namespace fxagent::test {

/// Other users of the line, whose turns end at once.
class Others final : public BusSharing {
 public:
  asio::awaitable<void> give_way(std::chrono::nanoseconds used) override {
    ++turns;
    used_before = used;
    co_return;
  }
  void was_silent(std::chrono::nanoseconds lasted) override { silence = lasted; }
  asio::awaitable<bool> give_way_after_silence() override {
    ++turns_after_silence;
    co_return polls_run;
  }
  void written_together(const Exchange&) override {}
  void concluded(std::size_t, const TargetResult&) override {}
  Reason why_stopping() const override { return stopping ? Reason::shutting_down : Reason::none; }
  bool may_send() const override { return !over; }

  int turns = 0;
  int turns_after_silence = 0;
  bool polls_run = true;                ///< after a silence
  std::chrono::nanoseconds silence{0};  ///< the last one
  std::chrono::nanoseconds used_before{0};
  bool stopping = false;
  bool over = false;
};

/// One bus, one station, and the script of what they exchange.
struct ScriptedBusTest : ::testing::Test {
  ~ScriptedBusTest() override {
    if (wire == nullptr) return;
    EXPECT_EQ(wire->steps_left(), 0U) << "the script was not played out";
  }

  /// On UDP if `udp` is given.
  void make_bus(std::chrono::nanoseconds char_time = {}, std::chrono::nanoseconds listening = {},
                std::optional<ScriptedTransport::Port> udp = {}) {
    auto transport = std::make_unique<ScriptedTransport>(io.get_executor());
    wire = transport.get();
    if (udp) wire->be_udp(*udp);
    bus = std::make_unique<Bus>(io.get_executor(), std::move(transport), char_time, listening);
  }
  void open() {
    const auto opened = run_on(io, bus->open());
    ASSERT_TRUE(opened) << opened.error().text;
  }
  Request request_for(std::string_view address) const {
    return Read{station.codec->addresses().parse_address(address, {})->span};
  }
  Exchange ask(Request request, SteadyTime not_after = SteadyTime::max()) {
    return run_on(io, bus->exchange(station, std::move(request), not_after));
  }
  Exchange read(std::string_view address) { return ask(request_for(address)); }

  asio::io_context io;
  ScriptedTransport* wire = nullptr;
  std::unique_ptr<Bus> bus;
  Station station;
};

}  // namespace fxagent::test
