// Carries out one admitted command on the wire: expect, write, verify, and the honest word for how
// it ended. Field thread. Its functions are the steps of that one act; what goes over the wire is
// CommandExchanges'.
#pragma once

#include <asio/awaitable.hpp>
#include <optional>
#include <string>
#include <vector>

#include "agent/commands/admitted_command.h"
#include "agent/config/config.h"
#include "agent/field/bus.h"
#include "agent/field/bus_sharing.h"
#include "agent/field/command_exchanges.h"
#include "agent/messages.h"
#include "protocol/plc.h"

namespace fxagent {

class CommandExecution final {
 public:
  /// All arguments outlive run(). `sharing` null: nobody shares the line, nobody stops the command.
  CommandExecution(asio::any_io_executor executor, Bus& bus, Station& station,
                   const DeviceConfig& device, const AdmittedCommand& admitted,
                   BusSharing* sharing = nullptr);

  /// The result, complete but for its bound. Opens the line once where it is closed.
  asio::awaitable<CommandResult> run();

  /// Line time since the line was last given to others.
  std::chrono::nanoseconds used() const { return wire_.used(); }

  /// Whether the device has answered anything, or has left something unanswered, during the run.
  bool was_answered() const { return wire_.was_answered(); }
  bool was_unanswered() const { return wire_.was_unanswered(); }

 private:
  asio::awaitable<void> run_targets();
  void conclude_target(TargetResult out);
  asio::awaitable<void> read_target(const AdmittedTarget& target, TargetResult& out);
  asio::awaitable<void> write_target(const AdmittedTarget& target, TargetResult& out);
  /// What must be known before the target is written: whether it is as expected, and what
  /// `requests` must leave as it is. False: nothing may be written, as `out` says.
  asio::awaitable<bool> read_first(const AdmittedTarget& target, std::vector<Request>& requests,
                                   TargetResult& out);
  /// Whether `target` shares a place with another of the command: then their sequence matters.
  bool meets_another(const AdmittedTarget& target) const;
  /// All targets in one frame, where the protocol has one for them. False: it has not.
  asio::awaitable<bool> write_together();
  /// `frames` of the target's requests were carried out and the rest surely was not.
  asio::awaitable<void> end_early(const AdmittedTarget& target, std::size_t frames,
                                  TargetResult& out);
  /// How a command ended that surely had no effect: refused, never sent, or too late.
  void set_without_effect(TargetResult& out, const Exchange& exchange) const;
  /// For people: the agent or the device stops. Only where there is a sharing_.
  std::string nothing_sent() const;
  /// What a command's last exchange means for one target; then its verification.
  asio::awaitable<void> conclude(const AdmittedTarget& target, Exchange exchange,
                                 TargetResult& out);
  bool surely_without_effect(const Request& request, const Exchange& exchange) const;
  asio::awaitable<void> verify(const AdmittedTarget& target, TargetResult& out);
  /// Reads what the command was to write: the same value counts as carried out.
  asio::awaitable<void> read_outcome(const AdmittedTarget& target, std::string succeeded,
                                     TargetResult& out);
  asio::awaitable<void> settle_interrupted();
  asio::awaitable<void> settle_unknown(const AdmittedTarget& target, const Exchange& lost,
                                       TargetResult& out);
  asio::awaitable<void> run_or_stop();
  asio::awaitable<std::optional<bool>> await_run_state(const PlcServices& plc, bool wanted);
  void summarise();

  Station& station_;
  const AdmittedCommand& admitted_;
  BusSharing* const sharing_;
  CommandExchanges wire_;
  CommandResult result_;
};

}  // namespace fxagent
