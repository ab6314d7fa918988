// The loop of one link: opens it, lets the Poller poll its devices, carries out their commands. One
// coroutine; what it does next is the PollScheduler's to say. Field thread.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/awaitable.hpp>
#include <asio/steady_timer.hpp>
#include <atomic>
#include <list>
#include <memory>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "agent/commands/admission.h"
#include "agent/config/config.h"
#include "agent/field/bus.h"
#include "agent/field/field.h"
#include "agent/field/link_device.h"
#include "agent/field/link_state.h"
#include "agent/field/poll_scheduler.h"
#include "agent/field/poller.h"
#include "agent/messages.h"
#include "agent/outbox.h"

namespace fxagent {

/// For each link the indices of its devices in Config::devices.
std::vector<std::vector<std::uint32_t>> devices_by_link(const Config& config);

class LinkWorker final {
 public:
  /// `config` and `outbox` outlive the worker; `link` is an index in Config::links, `devices` are
  /// its own of devices_by_link().
  LinkWorker(asio::any_io_executor executor, const Config& config, std::uint32_t link,
             std::span<const std::uint32_t> devices, Outbox& outbox,
             std::unique_ptr<Transport> transport, const RestoredState& restored, Polling polling,
             Journaling journaling,
             std::shared_ptr<CommandRoom> room = std::make_shared<CommandRoom>());
  LinkWorker(const LinkWorker&) = delete;
  LinkWorker& operator=(const LinkWorker&) = delete;
  ~LinkWorker();

  /// The next sample of the device has a higher number than this one.
  void number_above(std::uint32_t device, std::uint64_t seq);
  /// An id of an earlier run, which is not to be carried out again.
  void remember(const RememberedId& remembered);
  /// An order of an earlier run without a result. It is not sent again; where a read
  /// can tell what became of it, that read is made.
  void take_interrupted(Command command);

  /// Runs until stop(); then answers what still waits and returns.
  asio::awaitable<void> run();

  /// A command for a device of this link. Its result, whatever it is, goes to the outbox.
  void submit(Command command);

  /// The uplink's word that this command is in the journal: it waits for the wire from now on.
  void go_ahead(std::uint32_t device, const std::string& id);

  /// Ends run() within 3 s: a poll is cut short, waiting commands are answered FAILED
  /// shutting_down. Of the command under way nothing more is written; its exchange on the wire and
  /// what is to be read back have 2.5 s.
  void stop();
  /// Whether run() has ended. Any thread.
  bool has_ended() const { return ended_; }

  /// Adds this link's and its devices' counters.
  void report(FieldHealth& health);

 private:
  using Device = LinkDevice;
  struct Waiting {
    AdmittedCommand admitted;
    Device* device = nullptr;
    std::shared_ptr<const Codec>
        codec;  ///< the one it was planned with; the model may be found later
    std::chrono::nanoseconds line_time{0};
  };
  class Sharing;

  void add_device(std::uint32_t index, BackOff back_off);
  Device* device_of(std::uint32_t index);

  asio::awaitable<void> serve();
  /// After a bug: what was under way gets its result, and the link begins anew.
  void answer_after_fault(const std::string& what);

  asio::awaitable<void> idle_until(SteadyTime until);
  asio::awaitable<void> open_line();

  /// The answer to a command that no wire will see any more. `status`: whether it had been admitted
  /// before the end was asked for.
  static CommandResult unsent(const AdmittedCommand& admitted, CommandStatus status);
  asio::awaitable<void> run_command();
  /// Whether the next waiting command may go between two parts of the one under way: it takes no
  /// longer than `credit`, and touches nothing that a resting one of its device does.
  bool may_go_between(std::chrono::nanoseconds credit) const;
  void after_write(Device& device, const AdmittedTarget& target, const TargetResult& outcome);
  void enqueue(Waiting waiting);
  std::optional<std::chrono::nanoseconds> bound_of(const Waiting& command) const;
  void take_line_times(Waiting& waiting) const;
  /// A poll while a command rests. False: it put nothing on the line.
  asio::awaitable<bool> poll_between(PollScheduler::PollStep step);
  /// Line time of the enquiries that go before the first exchange with each device of a session.
  std::chrono::nanoseconds handshakes() const;

  asio::any_io_executor executor_;
  const Config& config_;
  const std::uint32_t link_;
  Outbox& outbox_;
  Bus bus_;
  PollScheduler scheduler_;
  LinkDevices devices_;
  LinkState state_;
  Poller poller_;
  asio::steady_timer idle_;
  std::unordered_map<std::uint32_t, Device*> by_index_;
  const Journaling journaling_;
  const std::shared_ptr<CommandRoom> room_;  ///< shared with admission; bytes of commands that wait
  std::list<Waiting> unjournaled_;           ///< admitted; without their go-ahead so far
  std::list<Waiting> waiting_;
  SteadyTime counting_since_{};
  /// The command under way; behind it the one that goes between two parts of it, and so on.
  std::list<Waiting> running_;
  Sharing* sharing_ = nullptr;  ///< of the last of them
  asio::steady_timer stop_timer_;
  bool over_ = false;  ///< what was under way at the stop has had its time
  std::atomic<bool> ended_ = false;
};

}  // namespace fxagent
