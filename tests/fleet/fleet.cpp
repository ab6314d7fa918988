#include "tests/fleet/fleet.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace fxfleet {
namespace {

using Json = nlohmann::ordered_json;
using std::chrono::duration;

constexpr milliseconds kTick{10};

double seconds_between(Time from, Time to) { return duration<double>(to - from).count(); }

/// Rounds to three decimals, for the report.
double rounded(double value) { return std::round(value * 1000) / 1000; }

double rate(std::uint64_t count, double time_s) {
  return time_s > 0 ? std::round(static_cast<double>(count) / time_s) : 0;
}

Json times_of(const Durations& times) {
  return {{"count", times.size()},
          {"p50_ms", rounded(times.percentile_ms(0.5))},
          {"p99_ms", rounded(times.percentile_ms(0.99))}};
}

Json or_null(const std::optional<double>& value) { return value ? Json(rounded(*value)) : Json(); }

}  // namespace

Fleet::Fleet(FleetOptions options)
    : options_(std::move(options)),
      commander_(io_, options_.plan, players_, options_.commands_per_second) {
  players_.reserve(options_.agents);
  for (unsigned number = 0; number < options_.agents; ++number) {
    players_.push_back(std::make_unique<Player>(io_, options_.plan, figures_, number));
    timers_.push_back(std::make_unique<asio::steady_timer>(io_));
    players_.back()->woken = [this, number] { wake(number); };
  }
}

Json Fleet::run() {
  if (!options_.broker_command.empty()) {
    broker_.emplace(options_.broker_command, options_.broker_log);
    broker_->start();
  }
  const Time now = std::chrono::steady_clock::now();
  phase_at_ = now;
  report_ = {{"agents", options_.agents}, {"complete", false}};
  tick();
  io_.run();
  report_["complete"] = !gave_up_;
  report_["totals"] = totals();
  return report_;
}

void Fleet::wake(unsigned number) {
  asio::steady_timer& timer = *timers_[number];
  timer.expires_at(players_[number]->next_wake());
  timer.async_wait([this, number](asio::error_code cancelled) {
    if (cancelled) return;
    players_[number]->step(std::chrono::steady_clock::now());
    wake(number);
  });
}

void Fleet::tick() {
  const Time now = std::chrono::steady_clock::now();
  step(now);
  if (phase_ == Phase::done) return;
  ticks_.expires_at(now + kTick);
  ticks_.async_wait([this](asio::error_code) { tick(); });
}

void Fleet::step(Time now) {
  const double in_phase = seconds_between(phase_at_, now);
  const bool all_connected = figures_.connected == options_.agents;
  if (broker_ && broker_->has_ended())
    throw std::runtime_error("the broker has ended: " + options_.broker_command);
  if (phase_ != Phase::broker) commander_.step(now);
  if (phase_ != Phase::steady && phase_ != Phase::after && in_phase > options_.patience_s) {
    gave_up_ = true;
    report_["gave_up"] = {{"phase", static_cast<int>(phase_)}, {"connected", figures_.connected}};
    if (phase_ == Phase::storm) report_["storm"] = storm_report(now);
    return begin(Phase::done, now);
  }
  switch (phase_) {
    case Phase::broker:
      if (is_answering()) begin(Phase::connect, now);
      break;
    case Phase::connect:
      connect_some(now);
      if (!all_connected || started_ < players_.size()) break;
      report_["connect"] = {
          {"all_s", rounded(in_phase)},
          {"connects_per_s", rate(figures_.connacks.size(), in_phase)},
          {"most_connects_in_a_second", figures_.most_connects_in_a_second(0)},
          {"failed_attempts", figures_.failures},
          {"broker_cpu_ms_per_connect",
           broker_ ? rounded((broker_->cpu_s() - mark_.broker_cpu) * 1000 / options_.agents) : 0}};
      begin(Phase::steady, now);
      break;
    case Phase::steady:
      if (in_phase < options_.storm_at.value_or(options_.seconds)) break;
      report_["steady"] = steady_report(now);
      begin(options_.storm_at ? Phase::storm : Phase::settle, now);
      break;
    case Phase::storm:
      storm(now);
      break;
    case Phase::after:
      if (in_phase < options_.seconds - options_.storm_at.value_or(0)) break;
      report_["after"] = steady_report(now);
      begin(Phase::settle, now);
      break;
    case Phase::settle:
      if (all_connected && commander_.is_done() &&
          std::all_of(players_.begin(), players_.end(),
                      [](const auto& player) { return player->is_done(); }))
        begin(Phase::done, now);
      break;
    case Phase::done:
      break;
  }
}

void Fleet::begin(Phase phase, Time now) {
  phase_ = phase;
  phase_at_ = now;
  mark_ = mark(now);
  figures_.acknowledgements.clear();
  if (phase == Phase::connect && broker_) empty_broker_kib_ = broker_->memory_kib();
  if (phase == Phase::storm) begin_storm(now);
  if (phase == Phase::settle) {
    commander_.stop();
    for (const auto& player : players_) player->stop_samples();
  }
  if (phase != Phase::done) return;
  for (const auto& timer : timers_) timer->cancel();
  for (const auto& player : players_) player->leave();
  commander_.leave();
  // Time for the last packets.
  ticks_.expires_at(now + milliseconds(300));
  ticks_.async_wait([this](asio::error_code) { io_.stop(); });
}

/// Keeps `at_once` players on their way until each has been started.
void Fleet::connect_some(Time now) {
  std::size_t under_way = started_ - std::min<std::size_t>(started_, figures_.connected);
  for (; started_ < players_.size() && under_way < options_.at_once; ++started_, ++under_way) {
    players_[started_]->start(now);
    players_[started_]->step(now);
    wake(static_cast<unsigned>(started_));
  }
}

void Fleet::begin_storm(Time now) {
  before_ = figures_;
  fewest_ = figures_.connected;
  killed_at_ = now;
  if (!options_.storm_command.empty()) {
    storm_command_.emplace("sh -c '" + options_.storm_command + "'", options_.broker_log);
    storm_command_->start();
    restarted_at_ = now;
  } else if (broker_) {
    broker_->kill();
  }
}

void Fleet::storm(Time now) {
  fewest_ = std::min(fewest_, figures_.connected);
  if (storm_command_) storm_command_->has_ended();
  if (!restarted_at_ && seconds_between(killed_at_, now) >= options_.down_s) {
    if (broker_) broker_->start();
    restarted_at_ = now;
    mark_.broker_cpu = 0;
  }
  const std::size_t lost = options_.agents - fewest_;
  if (!restarted_at_ || lost == 0) return;
  const std::size_t back = figures_.connected - fewest_;
  const double in_storm = seconds_between(*restarted_at_, now);
  if (!half_back_s_ && back * 2 >= lost) half_back_s_ = in_storm;
  if (!nearly_back_s_ && back * 100 >= lost * 99) nearly_back_s_ = in_storm;
  if (!all_back_s_ && back == lost) all_back_s_ = in_storm;
  // Over when each player has a connection and the broker has all samples of the outage.
  if (back < lost || std::any_of(players_.begin(), players_.end(),
                                 [](const auto& player) { return player->has_backlog(); }))
    return;
  report_["storm"] = storm_report(now);
  begin(Phase::after, now);
}

bool Fleet::is_answering() const {
  asio::io_context io;
  asio::ip::tcp::socket probe(io);
  asio::error_code error;
  probe.connect(options_.plan.servers.front(), error);
  return !error;
}

Fleet::Mark Fleet::mark(Time now) const {
  return {now, figures_.published, figures_.received, broker_ ? broker_->cpu_s() : 0, own_cpu_s()};
}

Json Fleet::steady_report(Time now) {
  const Mark end = mark(now);
  const double length = seconds_between(mark_.at, now);
  const auto messages = static_cast<double>(end.published - mark_.published);
  Json out{{"seconds", rounded(length)},
           {"published_per_s", rate(end.published - mark_.published, length)},
           {"received_per_s", rate(end.received - mark_.received, length)},
           {"acknowledgement", times_of(figures_.acknowledgements)},
           {"own_cpu_percent", rounded((end.own_cpu - mark_.own_cpu) / length * 100)}};
  if (broker_) {
    const long kib = broker_->memory_kib();
    out["broker_cpu_percent"] = rounded((end.broker_cpu - mark_.broker_cpu) / length * 100);
    out["broker_cpu_us_per_message"] =
        messages > 0 ? rounded((end.broker_cpu - mark_.broker_cpu) * 1e6 / messages) : 0;
    out["broker_rss_kib"] = kib;
    out["broker_rss_kib_per_session"] =
        rounded(static_cast<double>(kib - empty_broker_kib_) / options_.agents);
  }
  return out;
}

Json Fleet::storm_report(Time now) {
  const Mark end = mark(now);
  Json out{
      {"lost", options_.agents - fewest_},
      {"down_s", rounded(restarted_at_ ? seconds_between(killed_at_, *restarted_at_) : 0)},
      {"back_50_percent_s", or_null(half_back_s_)},
      {"back_99_percent_s", or_null(nearly_back_s_)},
      {"back_all_s", or_null(all_back_s_)},
      {"caught_up_s", rounded(restarted_at_ ? seconds_between(*restarted_at_, now) : 0)},
      {"most_connects_in_a_second", figures_.most_connects_in_a_second(before_.connacks.size())},
      {"attempts", figures_.attempts - before_.attempts},
      {"failed_attempts", figures_.failures - before_.failures},
      {"losses", figures_.losses - before_.losses},
      {"history_messages", figures_.history_messages - before_.history_messages},
      {"acknowledgement", times_of(figures_.acknowledgements)},
      {"own_cpu_s", rounded(end.own_cpu - mark_.own_cpu)}};
  if (broker_) {
    out["broker_cpu_s"] = rounded(end.broker_cpu - mark_.broker_cpu);
    out["broker_cpu_ms_per_connect"] =
        rounded((end.broker_cpu - mark_.broker_cpu) * 1000 /
                static_cast<double>(figures_.connacks.size() - before_.connacks.size()));
    out["broker_rss_kib"] = broker_->memory_kib();
  }
  return out;
}

Json Fleet::totals() const {
  return {{"connacks", figures_.connacks.size()},
          {"losses", figures_.losses},
          {"published", figures_.published},
          {"received", figures_.received},
          {"refused", figures_.refusals},
          {"samples_made", figures_.samples_made},
          {"samples_acknowledged", figures_.samples_acknowledged},
          {"commands_sent", commander_.sent()},
          {"commands_answered", commander_.answered()},
          {"commands_repeated", commander_.repeated()},
          {"commands_carried_out", figures_.commands_carried_out},
          {"second_results", commander_.second_results()},
          {"command_time", times_of(commander_.times())}};
}

}  // namespace fxfleet
