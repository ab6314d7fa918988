// Commands that pass through real admission, and their execution on a scripted bus.
#pragma once

#include <gtest/gtest.h>

#include <stdexcept>

#include "agent/commands/admission.h"
#include "agent/field/command/command_execution.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/scripted_bus.h"

namespace fxagent::test {

/// Returns a target by its tag; without a value for an operation that needs none.
inline CommandTarget target_of(std::string tag, std::optional<Value> value = std::nullopt) {
  return {std::move(tag), "", std::nullopt, std::move(value)};
}

/// Admits a command that has just been received; a refusal ends the test.
inline AdmittedCommand admitted(CommandAdmission& admission, Command command,
                                const std::shared_ptr<const Codec>& codec) {
  const SteadyTime now = std::chrono::steady_clock::now();
  command.received = now;
  auto decision = admission.admit(std::move(command), codec, 0, now);
  if (const auto* refused = std::get_if<CommandResult>(&decision))
    throw std::runtime_error("refused: " + std::string(to_string(refused->reason)) + " " +
                             refused->detail);
  return std::get<AdmittedCommand>(std::move(decision));
}

/// One line with one device; the test opens it and scripts its exchanges.
struct CommandBusTest : ScriptedBusTest {
  explicit CommandBusTest(DeviceConfig of = {}) : device(std::move(of)) {}
  CommandResult run(const AdmittedCommand& command) {
    CommandExecution execution(io.get_executor(), *bus, station, device, limits, command, others);
    CommandResult result = run_on(io, execution.run());
    was_answered = execution.exchanges().was_answered();
    was_unanswered = execution.exchanges().was_unanswered();
    return result;
  }

  DeviceConfig device;
  std::vector<Holes::Limit> limits;  ///< found by polls
  Others others;
  bool was_answered = false;
  bool was_unanswered = false;
};

}  // namespace fxagent::test
