// Carries out one admitted command on the wire: expect, write, verify, and the honest word for how
// it ended. Field thread.
#pragma once

#include <asio/awaitable.hpp>
#include <asio/steady_timer.hpp>
#include <optional>
#include <string>

#include "agent/commands/admitted_command.h"
#include "agent/config/config.h"
#include "agent/field/bus.h"
#include "agent/field/bus_sharing.h"
#include "agent/messages.h"
#include "protocol/plan.h"
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
  std::chrono::nanoseconds used() const;

  /// Whether the device has answered anything, or has left something unanswered, during the run.
  bool was_answered() const { return answered_; }
  bool was_unanswered() const { return unanswered_; }

  /// Line time of all exchanges of `admitted` when each ends well.
  static std::chrono::nanoseconds line_time(const Codec& codec, const DeviceConfig& device,
                                            std::chrono::nanoseconds char_time,
                                            const AdmittedCommand& admitted);
  /// Notes in `admitted` what its targets and, where the speed of the line is known, its own
  /// exchanges take.
  static void set_line_times(const Codec& codec, const DeviceConfig& device,
                             std::chrono::nanoseconds char_time, AdmittedCommand& admitted);
  /// Whether others have their turns in the midst of it: between the targets of a list, and between
  /// the exchanges of an array that takes longer than 2 s.
  static bool gives_way(const AdmittedCommand& admitted);

 private:
  struct ReadBack {
    std::optional<Bytes> image;  ///< of the whole point; nullopt: it could not be read
    Exchange last;
  };

  /// Until when an exchange may begin: a command whose first write has left is finished.
  SteadyTime latest_start() const;
  bool is_stopping() const { return sharing_ != nullptr && sharing_->is_stopping(); }
  /// Gives others their turn where `share` says so. False: the agent is to stop.
  asio::awaitable<bool> go_on(bool share);

  asio::awaitable<Exchange> ask(Request request, SteadyTime not_after);
  asio::awaitable<ReadBack> read_point(const AdmittedTarget& target, SteadyTime not_after);
  asio::awaitable<void> run_targets();
  void conclude_target(TargetResult out);
  asio::awaitable<void> read_target(const AdmittedTarget& target, TargetResult& out);
  asio::awaitable<void> write_target(const AdmittedTarget& target, TargetResult& out);
  asio::awaitable<bool> check_expected(const AdmittedTarget& target, TargetResult& out);
  /// Sends `request`, and before it the read that it needs; that read's failure is the command's.
  enum class Try : std::uint8_t { first, second };
  asio::awaitable<Exchange> send(Request request, Try which);
  /// Sends `request`, and a second time only where the first surely had no effect.
  asio::awaitable<Exchange> send_once_or_twice(Request request, bool may_repeat);
  /// Whether `target` shares a place with another of the command: then their sequence matters.
  bool meets_another(const AdmittedTarget& target) const;
  /// All targets in one frame, where the protocol has one for them. False: it has not.
  asio::awaitable<bool> write_together();
  /// `frames` of the target's requests were carried out and the rest surely was not.
  asio::awaitable<void> end_early(const AdmittedTarget& target, std::size_t frames,
                                  TargetResult& out);
  /// How a command ended that surely had no effect: refused, never sent, or too late.
  void set_without_effect(TargetResult& out, const Exchange& exchange) const;
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
  asio::awaitable<void> pause(std::chrono::milliseconds duration);
  void summarise();

  asio::steady_timer timer_;
  Bus& bus_;
  Station& station_;
  const DeviceConfig& device_;
  const AdmittedCommand& admitted_;
  BusSharing* const sharing_;
  CommandResult result_;
  std::optional<SteadyTime> first_byte_;
  std::optional<SteadyTime> part_began_;  ///< first byte since the line was given to others
  SteadyTime last_byte_{};
  bool wrote_ = false;    ///< a byte of a command has left
  bool cut_off_ = false;  ///< the end came before the answer
  bool answered_ = false;
  bool unanswered_ = false;
};

}  // namespace fxagent
