#include "tests/fleet/player.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/fleet/texts.h"

namespace fxfleet {
namespace {

using std::chrono::seconds;

constexpr seconds kKeepAlive{30};
constexpr seconds kHealthEvery{60};
constexpr seconds kNoAcknowledgement{30};
constexpr std::size_t kMaxWindow = 20;
constexpr std::size_t kSampleRoom = 2;  // places of the window that samples leave free
constexpr std::size_t kHistoryBytes = 16384;
constexpr std::size_t kSampleBytes = 176;
constexpr std::size_t kIdsKept = 64;
// Players of one source address: fewer than it has ports.
constexpr unsigned kPlayersOfAddress = 5000;

std::string boot_of(unsigned number) {
  const std::string digits = std::to_string(number);
  return std::string(8 - std::min<std::size_t>(8, digits.size()), '0') + digits;
}

}  // namespace

Player::Player(asio::io_context& io, const Plan& plan, Figures& figures, unsigned number)
    : plan_(plan),
      figures_(figures),
      name_("edge" + std::to_string(number)),
      base_(plan.root + "/" + name_),
      boot_(boot_of(number)),
      first_server_(number % plan.servers.size()),
      source_(asio::ip::address_v4::loopback().to_uint() + number / kPlayersOfAddress),
      started_ms_(utc_ms()),
      connection_(io, plan.version,
                  {[this] { opened(); }, [this](const Packet& packet) { received(packet); },
                   [this] { ended(); }}),
      reconnect_(plan.servers.size(), number + 1),
      random_(number + 1) {}

void Player::start(Time now) {
  const auto phase = [this](milliseconds period) {
    return milliseconds(std::uniform_int_distribution<long>(0, period.count())(random_));
  };
  link_ = Link::waiting;
  retry_at_ = now;
  sample_at_ = now + phase(plan_.interval);
  health_at_ = now + phase(kHealthEvery);
}

Time Player::next_wake() const {
  if (link_ == Link::idle) return Time::max();
  Time wake = makes_samples_ ? sample_at_ : Time::max();
  if (link_ == Link::waiting) return std::min(wake, retry_at_);
  if (link_ != Link::connected) return std::min(wake, deadline_);
  return std::min({wake, health_at_, sent_at_ + kKeepAlive});
}

void Player::step(Time now) {
  if (link_ == Link::idle) return;
  if (makes_samples_ && now >= sample_at_) {
    sample_at_ += plan_.interval;
    if (sample_at_ <= now) sample_at_ = now + plan_.interval;
    ++figures_.samples_made;
    const Row row{++seq_, utc_ms()};
    if (link_ == Link::connected && flights_.size() + kSampleRoom < window_ && due_.empty())
      send({{base_ + "/press1/data/fast", sample(boot_, row.seq, row.ts), plan_.qos, false},
            {row},
            {},
            false},
           now);
    else
      backlog_.push_back(row);
  }
  if (link_ == Link::waiting && now >= retry_at_) {
    link_ = Link::connecting;
    deadline_ = now + reconnect_.patience();
    ++figures_.attempts;
    connection_.open(plan_.servers[(reconnect_.server() + first_server_) % plan_.servers.size()],
                     source_);
  }
  if (is_under_way() && now >= deadline_) {
    connection_.close();
    ended();
  }
  if (link_ != Link::connected) return;
  if (!flights_.empty() && now - flights_.begin()->second.sent >= kNoAcknowledgement) {
    connection_.close();
    return lost(now);
  }
  if (now >= health_at_) {
    health_at_ += kHealthEvery;
    due_.push_back(retained("/health", health(boot_, seq_)));
  }
  pump(now);
  if (now - sent_at_ >= kKeepAlive) {
    put_pingreq(connection_.out());
    sent_at_ = now;
  }
}

void Player::leave() {
  if (link_ == Link::connected) {
    put_disconnect(connection_.out());
    --figures_.connected;
  } else {
    connection_.close();
  }
  link_ = Link::idle;
}

void Player::opened() {
  link_ = Link::greeting;
  const std::string will = agent_will(boot_);
  const std::string topic = base_ + "/state";
  put_connect(connection_.out(), plan_.version,
              {"fx-" + name_, static_cast<std::uint16_t>(kKeepAlive.count()), !plan_.keeps_session,
               topic, will});
}

void Player::received(const Packet& packet) {
  const Time now = std::chrono::steady_clock::now();
  if (link_ == Link::greeting && packet.type == PacketType::connack) return connack(packet, now);
  if (link_ != Link::connected) return;
  switch (packet.type) {
    case PacketType::publish:
      ++figures_.received;
      if (packet.id != 0) put_puback(connection_.out(), packet.id);
      sent_at_ = now;
      if (packet.topic.ends_with("/command")) command(packet);
      break;
    case PacketType::puback: {
      const auto flight = flights_.extract(packet.id);
      if (flight.empty()) break;
      if (packet.code >= 0x80) ++figures_.refusals;
      if (flight.mapped().message.is_history) --history_in_flight_;
      figures_.samples_acknowledged += flight.mapped().message.samples.size();
      figures_.acknowledgements.add(now - flight.mapped().sent);
      break;
    }
    case PacketType::suback:
      if (packet.code >= 0x80) ++figures_.refusals;
      break;
    default:
      break;
  }
  pump(now);
}

void Player::connack(const Packet& packet, Time now) {
  if (packet.code != 0) {
    connection_.close();
    return ended();
  }
  link_ = Link::connected;
  reconnect_.connected(now);
  window_ = std::clamp<std::size_t>(packet.receive_maximum, 1, kMaxWindow);
  ++figures_.connected;
  figures_.connacks.push_back(now);
  const struct {
    const char* filter;
    bool no_local;
  } subscriptions[] = {
      {"/state", false}, {"/+/command", true}, {"/+/state", false}, {"/+/meta", false}};
  for (const auto& [filter, no_local] : subscriptions)
    put_subscribe(connection_.out(), plan_.version, next_id(), base_ + filter, no_local);
  // Results of the last connection come behind the states.
  due_.push_front(retained("/health", health(boot_, seq_)));
  due_.push_front(retained("/press1/meta", device_meta()));
  due_.push_front(retained("/press1/state", device_state(started_ms_)));
  due_.push_front(retained("/state", agent_state(boot_, started_ms_)));
  sent_at_ = now;
  pump(now);
  woken();
}

void Player::ended() {
  const Time now = std::chrono::steady_clock::now();
  if (link_ == Link::idle) return;
  if (link_ == Link::connected) return lost(now);
  link_ = Link::waiting;
  ++figures_.failures;
  retry_at_ = reconnect_.after_failure(now);
  if (reconnect_.server() == 0) retry_at_ = std::max(retry_at_, now + plan_.spread);
  woken();
}

void Player::lost(Time now) {
  link_ = Link::waiting;
  --figures_.connected;
  ++figures_.losses;
  retry_at_ = reconnect_.after_loss(now);
  retry_at_ += milliseconds(std::uniform_int_distribution<long>(0, plan_.spread.count())(random_));
  // Results go out again, and samples as history; states are made anew.
  std::vector<Row> samples;
  for (auto& [id, flight] : flights_) {
    samples.insert(samples.end(), flight.message.samples.begin(), flight.message.samples.end());
    if (!flight.message.result_of.empty()) due_.push_front(std::move(flight.message));
  }
  std::erase_if(due_, [](const Message& message) { return message.publish.retain; });
  backlog_.insert(backlog_.end(), samples.begin(), samples.end());
  std::sort(backlog_.begin(), backlog_.end(),
            [](const Row& left, const Row& right) { return left.seq < right.seq; });
  flights_.clear();
  history_in_flight_ = 0;
  woken();
}

void Player::command(const Packet& packet) {
  ++figures_.commands_received;
  const auto json = nlohmann::json::parse(packet.payload, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !json.contains("id")) return;
  const auto id = json["id"].get<std::string>();
  const bool is_duplicate = std::find(commands_.begin(), commands_.end(), id) != commands_.end();
  if (!is_duplicate) {
    ++figures_.commands_carried_out;
    commands_.push_back(id);
    if (commands_.size() > kIdsKept) commands_.pop_front();
  }
  due_.push_back(result_message(id, is_duplicate));
}

void Player::pump(Time now) {
  while (link_ == Link::connected && !due_.empty() && flights_.size() < window_) {
    Message message = std::move(due_.front());
    due_.pop_front();
    send(std::move(message), now);
  }
  while (link_ == Link::connected && due_.empty() && !backlog_.empty() &&
         flights_.size() + kSampleRoom < window_)
    send(next_history(), now);
}

void Player::send(Message message, Time now) {
  ++figures_.published;
  sent_at_ = now;
  if (message.publish.qos == 0) {
    put_publish(connection_.out(), plan_.version, 0, message.publish);
    figures_.samples_acknowledged += message.samples.size();
    return;
  }
  const std::uint16_t id = next_id();
  put_publish(connection_.out(), plan_.version, id, message.publish);
  if (message.is_history) ++history_in_flight_;
  // Made again after a loss.
  if (message.result_of.empty()) message.publish = {};
  flights_.emplace(id, Flight{std::move(message), now});
}

Player::Message Player::next_history() {
  Message message;
  std::vector<std::string> rows;
  std::size_t taken = 0;
  for (std::size_t bytes = 0; taken < backlog_.size() && bytes + kSampleBytes < kHistoryBytes;
       ++taken) {
    const Row& row = backlog_[taken];
    rows.push_back(sample(boot_, row.seq, row.ts));
    message.samples.push_back(row);
    bytes += rows.back().size() + 1;
  }
  const auto end = backlog_.begin() + static_cast<std::ptrdiff_t>(taken);
  backlog_.erase(backlog_.begin(), end);
  if (backlog_.empty()) backlog_.shrink_to_fit();
  ++figures_.history_messages;
  message.is_history = true;
  message.publish = {base_ + "/press1/data/fast/history", history(rows), plan_.qos, false};
  return message;
}

Player::Message Player::result_message(const std::string& id, bool is_duplicate) const {
  return {{base_ + "/press1/result", result(id, is_duplicate), 1, false}, {}, id, false};
}

Player::Message Player::retained(const std::string& topic, std::string payload) const {
  return {{base_ + topic, std::move(payload), 1, true}, {}, {}, false};
}

std::uint16_t Player::next_id() {
  do {
    if (++last_id_ == 0) last_id_ = 1;
  } while (flights_.contains(last_id_));
  return last_id_;
}

}  // namespace fxfleet
