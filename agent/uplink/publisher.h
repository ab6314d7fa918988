// The uplink loop: what the field made goes to the broker, or waits; the commands that the broker
// brings go to Commands. It owns delivery: nothing is forgotten before its PUBACK, and the number
// of publishes that are not acknowledged stays below a window of its own, since the MQTT library
// under it slows to one window a second when its queue grows longer than the broker's receive
// maximum.
//
// With a store, a sample that has waited for its PUBACK for a second is on disk, and with
// `sync: always` each one is before it is sent; the backlog in memory then stands in where the disk
// refuses.
//
// Order of precedence: results, then states, then live samples, then the backlog beside them.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <stop_token>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "agent/commands/commands.h"
#include "agent/config/config.h"
#include "agent/messages.h"
#include "agent/outbox.h"
#include "agent/store/backlog.h"
#include "agent/store/store.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/json_payload.h"
#include "agent/uplink/payload.h"

namespace fxagent {

struct PublisherSettings {
  std::string boot;  ///< 8 hex digits, another at every start
  std::string version;
  std::size_t backlog_bytes = std::size_t{64} << 20;
  /// Of results that the broker does not have yet. Above it the agent ends its subscription to
  /// commands, until half of them are out.
  std::size_t result_bytes = std::size_t{16} << 20;
  std::uint32_t jitter_seed =
      1;  ///< of the retry times, so that a plant does not reconnect at once
};

/// Uplink thread only. Time is an argument; `utc_ms` tells the calendar time of "now".
class Publisher final {
 public:
  using UtcClock = std::function<std::int64_t()>;
  using NumberAbove = std::function<void(std::vector<std::uint64_t>)>;

  /// All references outlive the publisher. `store` null: memory alone; else it is the journal of
  /// `commands` too. `number_above` is called from step() when a store that was not there at the
  /// start has opened: samples are numbered above these from then on, by device.
  Publisher(const Config& config, PublisherSettings settings, Payload& payload, Outbox& outbox,
            Broker& broker, Commands& commands, UtcClock utc_ms, Store* store = nullptr,
            NumberAbove number_above = {});
  ~Publisher();
  Publisher(const Publisher&) = delete;
  Publisher& operator=(const Publisher&) = delete;

  /// Takes all news and does what is due. Returns when it must be called again at the latest;
  /// sooner where the outbox or the broker has news.
  SteadyTime step(SteadyTime now);
  /// Until when samples may gather before the next step: a hundredth of their interval while they
  /// stream in, and the time of the last step where they do not.
  SteadyTime gather_until() const { return gather_until_; }

  /// Begins the clean end: what waits is published for up to 3 s, results first, then the agent's
  /// state goes to offline and the connection is closed. step() does the work until finished().
  void stop(SteadyTime now);
  bool finished() const { return phase_ == Phase::finished; }

  /// Where every sample is, as of the last step().
  json::Samples samples() const;

 private:
  /// A sample that waited longer is on disk, or else is history.
  static constexpr std::chrono::seconds kLiveFor{1};
  /// Rows for the disk are gathered so long.
  static constexpr std::chrono::milliseconds kCommitWithin{200};

  static constexpr std::chrono::seconds kLogDropsEvery{10};

  /// leaving: goodbye was said to connect anew, and what was read before it still comes.
  enum class Link : std::uint8_t { waiting, connecting, connected, leaving };
  enum class Phase : std::uint8_t { running, draining, farewell, closing, finished };

  // What is published besides samples and results. Lower comes first.
  enum class Notice : std::uint8_t { agent_state, device_state, device_meta, health, clear };
  struct NoticeKey {
    Notice notice = Notice::agent_state;
    std::uint32_t device = 0;
    std::string topic;  ///< clear only
    auto operator<=>(const NoticeKey&) const = default;
  };
  struct Due {
    SteadyTime not_before{};
    int failures = 0;
  };

  /// A result on its way to one or two topics.
  struct PendingResult {
    ResultMessage result;
    bool handed_over = false;  ///< to MQTT, once: total_ms ends there
    std::size_t bytes = 0;     ///< that it takes in memory, roughly
    struct Copy {
      std::string topic{};
      bool to_response_topic = false;
      bool in_flight = false;
      bool done = false;
      bool acknowledged = false;
      Due due{};
    };
    std::vector<Copy> copies;
  };

  /// Messages of QoS 1 that have come.
  struct Heard {
    std::uint64_t messages = 0;
    std::uint64_t bytes = 0;
  };

  // What an unacknowledged publish was, by its id.
  struct NoticeFlight {
    NoticeKey key;
    int failures = 0;
  };
  struct ResultFlight {
    std::uint64_t result = 0;
    std::size_t copy = 0;
    std::optional<Heard> heard{};  ///< before it went; none: nothing was held back then
  };
  struct LiveRow {
    SampleRow row;
    SteadyTime since{};
    bool stored = false;  ///< on disk too, and held there
  };
  struct LiveFlight {
    LiveRow live;
  };
  struct HistoryFlight {
    HistoryBatch batch;
    bool on_disk = false;
    SteadyTime since{};
  };
  struct FarewellFlight {};
  using Flight =
      std::variant<NoticeFlight, ResultFlight, LiveFlight, HistoryFlight, FarewellFlight>;

  /// A device whose samples the broker refuses for the time being.
  struct DevicePause {
    SteadyTime until{};
    int failures = 0;
    int reason_code = 0;
  };

  void on(const Connected& event, SteadyTime now);
  void on(const ConnectFailed& event, SteadyTime now);
  void on(const Lost& event, SteadyTime now);
  void on(const Disconnected& event, SteadyTime now);
  void on(const Message& event, SteadyTime now);
  void on(const Delivered& event, SteadyTime now);
  void on(const DeliveryFailed& event, SteadyTime now);
  void on(const Subscribed& event, SteadyTime now);
  void on(const MessagesDropped& event, SteadyTime now);

  void take_found_late(SteadyTime now);
  void take_outbox(SteadyTime now);
  void take_samples(const std::vector<Telemetry>& messages, SteadyTime now);
  void note_incoming(const Message& event, std::uint32_t device);
  void take_incoming(SteadyTime now);
  void take_result(ResultMessage result);

  void keep_connected(SteadyTime now);
  void watch_connection(SteadyTime now);
  SteadyTime watch_wake() const;
  void connection_over(SteadyTime now);
  void retry_after_failure(SteadyTime now);
  void retry_after_loss(SteadyTime now);
  void subscribe_to_commands(SteadyTime now);
  void keep_subscribed(SteadyTime now);
  void commands_unheard(const std::string& reason, SteadyTime now);
  void stop_listening(SteadyTime now);
  bool is_far_behind(const Flight& flight) const;
  bool broker_runs_ahead() const;
  void connect_anew(SteadyTime now);
  void connect(SteadyTime now);
  bool awaits_first_suback() const { return suback_by_ && !deaf_; }
  void note_acknowledgement(const Flight& flight, SteadyTime now);
  bool is_acknowledged_by_broker(const Flight& flight) const;
  void tick(SteadyTime now);

  void pump(SteadyTime now);
  void pump_results(SteadyTime now);
  void hold_messages(SteadyTime now);
  std::size_t result_window() const;
  void pump_notices(SteadyTime now);
  void pump_live(SteadyTime now);
  void pump_history(SteadyTime now);
  void overflow(SteadyTime now);
  void hold_on_disk(SteadyTime now);
  std::optional<HistoryFlight> next_history(SteadyTime now);
  void wind_up(SteadyTime now);
  bool drained() const;
  void say_farewell(SteadyTime now);

  void failed(const NoticeFlight& flight, const DeliveryFailed& event, SteadyTime now);
  void failed(const ResultFlight& flight, const DeliveryFailed& event, SteadyTime now);
  void failed(LiveFlight& flight, const DeliveryFailed& event, SteadyTime now);
  void failed(const HistoryFlight& flight, const DeliveryFailed& event, SteadyTime now);
  void failed(const FarewellFlight& flight, const DeliveryFailed& event, SteadyTime now);
  void delivered(const NoticeFlight& flight, SteadyTime now);
  void delivered(const ResultFlight& flight, SteadyTime now);
  void delivered(const LiveFlight& flight, SteadyTime now);
  void delivered(const HistoryFlight& flight, SteadyTime now);
  void delivered(const FarewellFlight& flight, SteadyTime now);

  void send(Flight flight, Publication publication);
  bool fits(const Publication& publication) const;
  std::size_t sample_window() const;
  bool acknowledgements_matter() const;
  bool has_room() const { return flights_.size() < window_; }
  bool may_send(const std::string& device, SteadyTime now) const;
  void pause(const std::string& device, int reason_code, SteadyTime now);
  /// A history message is over, in whatever way.
  void rest_history(const HistoryFlight& flight, SteadyTime now);
  void spool(SampleRow row);
  void spool(LiveRow live);
  void spool_live();
  /// What was put away goes to the disk, several rows at once; or into memory, at once.
  void commit_spool(SteadyTime now);
  void write_spool();
  void move_memory_to_disk();
  void count_dropped();
  void drop(const std::string& device, std::uint64_t count);
  enum class Ended : std::uint8_t { acknowledged, refused };
  void result_copy_done(std::uint64_t result, std::size_t copy, Ended how);
  SteadyTime::duration back_off(int failures, std::chrono::milliseconds longest);
  SteadyTime::duration back_off(int failures);
  SteadyTime next_wake(SteadyTime now) const;
  std::string device_topic(std::uint32_t device) const;
  std::string health_text(SteadyTime now) const;

  const Config& config_;
  const PublisherSettings settings_;
  const std::string base_;
  Payload& payload_;
  Outbox& outbox_;
  Broker& broker_;
  Commands& commands_;
  const UtcClock utc_ms_;
  Store* const store_;
  const NumberAbove number_above_;
  std::minstd_rand jitter_;

  // the connection
  Link link_ = Link::waiting;
  bool starting_ = true;  ///< the first attempt to connect is not over
  std::size_t server_ = 0;
  int failed_rounds_ = 0;              ///< through all servers, none of which took us
  int thrown_rounds_ = 0;              ///< through all servers, none of which kept us for long
  SteadyTime::duration last_pause_{};  ///< between the last loss and the attempt after it
  std::optional<SteadyTime> last_up_;  ///< when there was a connection
  SteadyTime retry_at_{};
  std::string last_failure_;
  SteadyTime connect_deadline_{};
  SteadyTime connected_at_{};
  std::optional<SteadyTime> down_since_;  ///< the library has no connection and has not said so

  // the subscription to commands
  std::optional<SteadyTime> suback_by_;  ///< asked for: until when the answer may take
  std::optional<SteadyTime> ask_again_at_;
  int unheard_ = 0;                  ///< refusals and silences of this connection, in a row
  std::optional<std::string> deaf_;  ///< why commands are not heard, as the agent's state says it
  bool paused_ = false;              ///< they are not heard since too many results wait
  std::optional<SteadyTime> clean_up_until_;  ///< looking for retained topics of unknown devices
  std::size_t window_ = 0;                    ///< publishes that may be unacknowledged
  std::size_t max_packet_ = 0;                ///< bytes the broker takes
  std::uint16_t receive_maximum_ = kReceiveMaximum;  ///< until a connection is lost
  Heard heard_;

  // what is on its way
  std::uint64_t next_id_ = 1;
  std::map<std::uint64_t, Flight> flights_;
  std::vector<DeliveryFailed> unsendable_;  ///< found by send(); reported at the end of the step
  std::size_t history_flights_ = 0;
  SteadyTime history_rests_until_{};                ///< live samples have the line to themselves
  std::uint64_t in_flight_samples_ = 0;             ///< that are not on disk
  bool handed_over_ = false;                        ///< a message went to the library in this step
  std::optional<SteadyTime> unacknowledged_since_;  ///< the first message, or the last answer

  // what waits
  std::map<NoticeKey, Due> due_;
  std::uint64_t next_result_ = 1;
  std::map<std::uint64_t, PendingResult> results_;
  std::size_t result_bytes_ = 0;
  std::set<std::uint64_t> refused_results_;  ///< that the broker has refused once: they come again
  /// Commands that have come and were not looked at yet, with their devices.
  std::deque<std::pair<Message, std::uint32_t>> incoming_;
  std::size_t incoming_bytes_ = 0;
  bool holding_ = false;    ///< messages stay in the network
  bool lets_in_ = false;    ///< some all the same, for what comes behind them
  SteadyTime let_in_at_{};  ///< holding all the same: some are let in then, for what comes behind
  std::uint64_t unasked_dropped_ = 0;  ///< commands of QoS 0 that found no room; not logged yet
  SteadyTime drop_logged_at_{};
  bool samples_first_ = false;  ///< whose turn it is, where the window is too small to share
  std::uint64_t next_row_id_ = 1;
  std::deque<LiveRow> live_;
  std::vector<SampleRow> spool_;  ///< for the store, at the next commit
  SteadyTime commit_at_{};
  SteadyTime samples_at_{};  ///< the last step that found some
  SteadyTime gather_until_{};
  Backlog backlog_;
  std::size_t history_bytes_;  ///< of one message; shrinks where the broker finds it too large

  // per device, by index
  std::vector<std::string> meta_hashes_;
  std::vector<std::optional<DeviceStatus>> states_;

  // per device, by name: the store may hold rows of devices that the config no longer has
  std::map<std::string, DevicePause> pauses_;
  std::map<std::string, std::uint64_t> dropped_;

  // counters
  std::uint64_t pushed_ = 0;
  std::uint64_t acknowledged_ = 0;
  std::uint64_t dropped_total_ = 0;
  std::uint64_t dropped_at_tick_ = 0;
  std::uint64_t published_ = 0;
  FieldHealth field_;
  bool miscounted_ = false;      ///< field_ does not agree with what the outbox has handed over
  std::uint64_t row_bytes_ = 0;  ///< serialised since the last tick, for hours_left
  std::optional<double> bytes_per_hour_;

  std::optional<SteadyTime> started_;
  std::int64_t started_ms_ = 0;
  SteadyTime next_tick_{};
  SteadyTime last_tick_{};

  Phase phase_ = Phase::running;
  SteadyTime phase_deadline_{};
};

/// The uplink thread: steps the publisher whenever there is news or something is due, until `stop`
/// was asked for and the clean end is done. `stepped` is called after each step.
void run_uplink(Publisher& publisher, Outbox& outbox, std::stop_token stop,
                const std::function<void()>& stepped = {});

}  // namespace fxagent
