// One link: opens it, polls its devices at their intervals, carries out their commands. One
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
#include "agent/field/hole_map.h"
#include "agent/field/poll_scheduler.h"
#include "agent/field/reconnect_policy.h"
#include "agent/field/report_by_exception.h"
#include "agent/messages.h"
#include "agent/outbox.h"
#include "protocol/plan.h"

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
  struct GroupPoll;
  struct Device;
  struct Waiting {
    AdmittedCommand admitted;
    Device* device = nullptr;
    std::shared_ptr<const Codec>
        codec;  ///< the one it was planned with; the model may be found later
    std::chrono::nanoseconds line_time{0};
  };
  class Sharing;

  void add_device(std::uint32_t index, BackOff back_off, Polling polling);
  Device* device_of(std::uint32_t index);
  void make_plan(Device& device, GroupPoll& group);
  /// A new plan where the device was found to have holes, or other times, since the last one.
  void refresh_plan(Device& device, GroupPoll& group);

  asio::awaitable<void> serve();
  /// After a bug: what was under way gets its result, and the link begins anew.
  void answer_after_fault(const std::string& what);

  asio::awaitable<void> idle_until(SteadyTime until);
  asio::awaitable<void> open_line();
  void line_up();
  /// Logs what was heard that nobody asked for, and what that means.
  void tell_doubt();
  void line_lost(const std::string& why);

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
  std::chrono::nanoseconds longest_poll() const;
  /// Line time of the enquiries that go before the first exchange with each device of a session.
  std::chrono::nanoseconds handshakes() const;

  asio::awaitable<void> run_step(PollScheduler::PollStep step);
  asio::awaitable<void> read_run_state(Device& device, PollScheduler::PollStep step);
  enum class Knowledge : std::uint8_t { known, plan_changed, unanswered };
  /// Asks for the model where the config leaves it open. `failure` says why it went unanswered.
  asio::awaitable<Knowledge> know_model(Device& device, BadReason& failure);
  void take_reading(Device& device, GroupPoll& group, const PollScheduler::PollStep& step,
                    Exchange exchange);
  /// The device said no to a read. True where the same read is to be offered again.
  bool take_refusal(Device& device, GroupPoll& group, const PollScheduler::PollStep& step,
                    const Exchange& exchange, RefusalMeaning meaning);
  void fail_cycle(Device& device, GroupPoll& group, BadReason why);
  void finish_cycle(Device& device, GroupPoll& group);
  void publish(Device& device, Telemetry message);

  void note_load();
  void note_answer(Device& device);
  void note_silence(Device& device);
  /// A gateway answered in its place: the device is silent, the connection is not.
  void note_unreachable(Device& device);
  void update_status(Device& device);

  asio::any_io_executor executor_;
  const Config& config_;
  const std::uint32_t link_;
  Outbox& outbox_;
  Bus bus_;
  PollScheduler scheduler_;
  asio::steady_timer idle_;
  std::vector<std::unique_ptr<Device>> devices_;
  std::unordered_map<std::uint32_t, Device*> by_index_;
  const Journaling journaling_;
  const std::shared_ptr<CommandRoom> room_;  ///< shared with admission; bytes of commands that wait
  std::list<Waiting> unjournaled_;           ///< admitted; without their go-ahead so far
  std::list<Waiting> waiting_;
  SteadyTime next_open_{};
  std::string why_down_ = "not opened yet";
  bool was_open_ = false;
  bool echo_told_ = false;
  bool unexpected_told_ = false;
  bool doubt_told_ = false;
  std::optional<SteadyTime> doubt_told_at_;
  int unanswered_in_a_row_ = 0;
  ReconnectPolicy reconnect_policy_;
  SteadyTime counting_since_{};
  std::chrono::nanoseconds first_poll_after_{0};  ///< the opening, of the group added next
  bool overloaded_ = false;
  /// The command under way; behind it the one that goes between two parts of it, and so on.
  std::list<Waiting> running_;
  Sharing* sharing_ = nullptr;  ///< of the last of them
  bool polling_ = false;        ///< a poll is on the wire, perhaps between two parts of a command
  bool stopping_ = false;
  asio::steady_timer stop_timer_;
  bool over_ = false;  ///< what was under way at the stop has had its time
  std::atomic<bool> ended_ = false;
};

}  // namespace fxagent
