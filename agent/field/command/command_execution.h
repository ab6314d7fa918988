// Carries out one admitted command on the wire (expect, write, verify) and reports how it ended.
// Its functions are the steps of a command; CommandExchanges performs the exchanges. Field thread.
#pragma once

#include <asio/awaitable.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "agent/commands/admitted_command.h"
#include "agent/config/model.h"
#include "agent/field/bus/bus.h"
#include "agent/field/command/command_exchanges.h"
#include "agent/handover/command_message.h"
#include "protocol/plc.h"

namespace fxagent {

class CommandExecution final {
 public:
  /// All arguments must outlive run(). `limits` as for reads_of().
  CommandExecution(asio::any_io_executor executor, Bus& bus, Station& station,
                   const DeviceConfig& device, std::span<const Holes::Limit> limits,
                   const AdmittedCommand& admitted, BusSharing& sharing);

  /// Returns the result, complete except for its bound. Opens the channel if it is closed.
  asio::awaitable<CommandResult> run();

  /// The exchanges of the run.
  const CommandExchanges& exchanges() const { return wire_; }

 private:
  asio::awaitable<void> run_targets();
  void conclude_target(TargetResult out);
  asio::awaitable<void> read_target(const AdmittedTarget& target, TargetResult& out);
  asio::awaitable<void> write_target(const AdmittedTarget& target, TargetResult& out);
  /// Reads what must be known before the target is written: whether it is as expected, and the bits
  /// that `requests` must preserve. False: nothing may be written; `out` says why.
  asio::awaitable<bool> read_first(const AdmittedTarget& target, std::vector<Request>& requests,
                                   TargetResult& out);
  /// Writes all targets in one frame if the protocol has one for them. False: nothing was sent.
  asio::awaitable<bool> write_together();
  /// Ends a target of which `frames` requests were carried out and the rest surely was not.
  asio::awaitable<void> end_early(const AdmittedTarget& target, std::size_t frames,
                                  TargetResult& out);
  /// Sets the outcome of a command that surely had no effect: refused, never sent, or too late.
  void set_without_effect(TargetResult& out, const Exchange& exchange) const;
  /// Sets the outcome of a command that may have had an effect.
  void set_unknown(TargetResult& out, const Exchange& lost) const;
  /// Sets the outcome of one target from the command's last exchange, then verifies it.
  asio::awaitable<void> conclude(const AdmittedTarget& target, Exchange exchange,
                                 TargetResult& out);
  asio::awaitable<void> verify(const AdmittedTarget& target, TargetResult& out);
  /// Reads what the command was to write. The target counts as carried out if it has that value.
  asio::awaitable<void> read_outcome(const AdmittedTarget& target, std::string succeeded,
                                     TargetResult& out);
  asio::awaitable<void> settle_interrupted();
  asio::awaitable<void> settle_unknown(const AdmittedTarget& target, const Exchange& lost,
                                       TargetResult& out);
  asio::awaitable<void> run_or_stop();
  asio::awaitable<std::optional<bool>> await_run_state(const PlcServices& plc, bool wanted);

  Station& station_;
  const AdmittedCommand& admitted_;
  BusSharing& sharing_;
  CommandExchanges wire_;
  CommandResult result_;
};

}  // namespace fxagent
