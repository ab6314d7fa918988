#include "agent/uplink/paho/paho_connection.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <climits>
#include <cstring>

#include "agent/steady_time.h"
#include "agent/uplink/paho/incoming_packets.h"
#include "agent/uplink/paho/reading_thread.h"
#include "agent/uplink/paho/socket_calls.h"

namespace fxagent {
namespace {

using std::chrono::seconds;

// Far above the publisher's window: Paho throws when its buffer is full, connected or not.
constexpr int kPahoBuffer = 10000;
constexpr int kPahoInFlight = 1000;  // above the publisher's window, so that Paho never queues
// For TCP_NODELAY. Without it the second of two small messages waits for the ACK of the first: 40
// ms, if the peer delays its ACKs.
constexpr int kOn = 1;
constexpr int kMostHeld = 128 << 10;  // bytes; the kernel doubles it for its own overhead

/// Returns 0 if `fd` is not a socket or the system has no cookies.
std::uint64_t cookie_of(int fd) {
  std::uint64_t cookie = 0;
  socklen_t length = sizeof(cookie);
  return getsockopt(fd, SOL_SOCKET, SO_COOKIE, &cookie, &length) == 0 ? cookie : 0;
}

/// Converts the scheme of a normal_server() to those that Paho 1.2 supports best.
std::string paho_uri(std::string_view server) {
  return (is_tls(server) ? "ssl" : "tcp") + std::string(server.substr(server.find("://")));
}

mqtt::property number_property(mqtt::property::code code, std::uint32_t value) {
  return {code, static_cast<std::int32_t>(value)};
}

Connected connected_by(const mqtt::token& token) {
  Connected event;
  const mqtt::connect_response response = token.get_connect_response();
  event.session_present = response.is_session_present();
  const mqtt::properties& properties = response.get_properties();
  using Code = mqtt::property::code;
  if (properties.contains(Code::RECEIVE_MAXIMUM))
    event.receive_maximum = mqtt::get<std::uint16_t>(properties, Code::RECEIVE_MAXIMUM);
  if (properties.contains(Code::MAXIMUM_PACKET_SIZE))
    event.maximum_packet = mqtt::get<std::uint32_t>(properties, Code::MAXIMUM_PACKET_SIZE);
  return event;
}

std::uint64_t id_of(const mqtt::token& token) {
  return reinterpret_cast<std::uint64_t>(token.get_user_context());
}

std::string filter_of(const mqtt::token& token) {
  const auto topics = token.get_topics();
  return topics && !topics->empty() ? (*topics)[0] : std::string();
}

Subscribed subscribed(const mqtt::token& token, const FailureText& texts) {
  Subscribed event{filter_of(token), false, "a SUBACK without a reason code"};
  // A named object, because it owns what get_reason_codes() returns.
  const mqtt::subscribe_response response = token.get_subscribe_response();
  const auto& codes = response.get_reason_codes();
  if (codes.empty()) return event;
  // One filter, one code. If there are more (on 3.1.1), Paho's codes are invalid and not even
  // values of its enumeration, so the bits are read.
  int code = 0;
  static_assert(sizeof code == sizeof codes.front());
  std::memcpy(&code, &codes.front(), sizeof code);
  event.granted = code >= 0 && code <= 2;
  if (event.granted)
    event.text.clear();
  else if (code >= 0x80 && code <= 0xFF)
    event.text = texts.of_refused_topic(code);
  else
    event.text = "a SUBACK that does not match the request";
  return event;
}

}  // namespace

bool is_tls(std::string_view server) { return server.starts_with("mqtts://"); }

void BorrowedSocket::watch(int fd) noexcept {
  const std::lock_guard lock(mutex_);
  fd_ = fd;
  cookie_ = cookie_of(fd);
  if (paused_) apply();
}

void BorrowedSocket::pause(bool paused) noexcept {
  const std::lock_guard lock(mutex_);
  if (paused_ == paused) return;
  paused_ = paused;
  apply();
}

void BorrowedSocket::shut_down() noexcept {
  const std::lock_guard lock(mutex_);
  // A copy stays the same socket if the library closes its own meanwhile.
  const int copy = cookie_ == 0 ? -1 : fcntl(fd_, F_DUPFD_CLOEXEC, 0);
  if (copy < 0) return;
  if (cookie_of(copy) == cookie_) ::shutdown(copy, SHUT_RDWR);
  ::close(copy);
}

void BorrowedSocket::apply() noexcept {
  if (cookie_ == 0 || cookie_of(fd_) != cookie_) return;
  // The kernel reduces INT_MAX to half of its buffer. When the value becomes 1 again, it wakes a
  // waiting poll() at once if data has arrived.
  const int least = paused_ ? INT_MAX : 1;
  // Without a limit the kernel would buffer megabytes, and later packets of the peer would wait
  // behind them.
  if (paused_) setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &kMostHeld, sizeof(kMostHeld));
  setsockopt(fd_, SOL_SOCKET, SO_RCVLOWAT, &least, sizeof(least));
}

PahoConnection::PahoConnection(std::shared_ptr<PahoInbox> inbox, std::uint64_t number,
                               const MqttConfig& config, const std::string& server,
                               std::size_t max_payload, seconds keep_session,
                               const SettingNames& names)
    : inbox_(std::move(inbox)),
      number_(number),
      config_(config),
      max_payload_(max_payload),
      keep_session_(keep_session),
      version_(config.version == 5 ? MQTTVERSION_5 : MQTTVERSION_3_1_1),
      tls_(is_tls(server)),
      failure_text_(config_, names, version_, tls_),
      client_(paho_uri(server), config.client_id,
              mqtt::create_options_builder()
                  .mqtt_version(version_)
                  .max_buffered_messages(kPahoBuffer)
                  .finalize()) {
  trace_errors_alone();
  client_.set_callback(*this);
  // On a DISCONNECT of the broker, Paho closes the socket and calls only this handler, never
  // connection_lost().
  client_.set_disconnected_handler(
      [this](const mqtt::properties& properties, mqtt::ReasonCode reason) noexcept {
        try {
          const int code = static_cast<int>(reason);
          post_lost(disconnect_text(properties, code), code);
        } catch (...) {
          post_lost("the broker said goodbye");
        }
      });
}

void PahoConnection::connect(const Publication& will, const std::optional<std::string>& password,
                             std::uint16_t receive_maximum) {
  mqtt::connect_options options;
  options.set_mqtt_version(version_);
  if (version_ == MQTTVERSION_5) {
    options.set_clean_start(keep_session_.count() == 0);
    using Code = mqtt::property::code;
    mqtt::properties properties;
    properties.add(number_property(Code::SESSION_EXPIRY_INTERVAL,
                                   static_cast<std::uint32_t>(keep_session_.count())));
    properties.add(number_property(Code::MAXIMUM_PACKET_SIZE, kMaxPacketIn));
    properties.add(number_property(Code::RECEIVE_MAXIMUM, receive_maximum));
    options.set_properties(std::move(properties));
  } else {
    options.set_clean_session(true);
  }
  options.set_keep_alive_interval(config_.keep_alive);
  options.set_connect_timeout(kPahoConnectTimeout);
  options.set_automatic_reconnect(false);
  options.set_max_inflight(kPahoInFlight);
  if (!config_.username.empty()) options.set_user_name(config_.username);
  if (password) options.set_password(mqtt::binary_ref(*password));
  if (!will.topic.empty())
    options.set_will_message(
        mqtt::message(will.topic, will.payload, 1, will.retain == Retain::yes));
  if (tls_) {
    trace_tls_failures();  // until the outcome is known
    mqtt::ssl_options_builder tls;
    tls.enable_server_cert_auth(true).verify(true);
    if (config_.tls) {
      if (!config_.tls->ca_file.empty()) tls.trust_store(config_.tls->ca_file);
      if (!config_.tls->cert_file.empty()) tls.key_store(config_.tls->cert_file);
      if (!config_.tls->key_file.empty()) tls.private_key(config_.tls->key_file);
    }
    options.set_ssl(tls.finalize());
  }
  connecting_since_ = std::chrono::steady_clock::now();
  client_.connect(options, nullptr, *this);
}

mqtt::token_ptr PahoConnection::disconnect() {
  leaving_ = true;
  socket_.pause(false);
  return client_.disconnect(0, nullptr, *this);
}

void PahoConnection::break_off() noexcept {
  leaving_ = broken_off_ = true;
  socket_.shut_down();
}

void PahoConnection::publish(Publication publication) {
  mqtt::properties properties;
  if (version_ == MQTTVERSION_5 && !publication.correlation.empty())
    properties.add({mqtt::property::CORRELATION_DATA,
                    std::string(publication.correlation.begin(), publication.correlation.end())});
  // The id travels as the token's context, because the callback may run before this call returns.
  client_.publish(
      mqtt::message::create(std::move(publication.topic), std::move(publication.payload),
                            publication.qos, publication.retain == Retain::yes, properties),
      reinterpret_cast<void*>(publication.id), *this);
}

void PahoConnection::subscribe(const Subscription& subscription) {
  mqtt::subscribe_options options;
  if (version_ == MQTTVERSION_5) {
    options.set_no_local(subscription.no_local);
    options.set_retain_as_published(true);
  }
  client_.subscribe(subscription.filter, subscription.qos, nullptr, *this, options);
}

void PahoConnection::post_lost(std::string_view text, int reason_code) noexcept {
  if (leaving_) return;  // the end of our own disconnect; Disconnected reports it
  if (lost_.exchange(true)) return;
  try {
    post(Lost{std::string(text), reason_code});
  } catch (...) {
    lost_ = false;  // out of memory; the next failure reports the loss again
  }
}

void PahoConnection::hold_messages(bool held, std::size_t let_in) noexcept {
  held_ = held;
  if (leaving_ && !held) return;
  let_in_ = held ? let_in : 0;
  socket_.pause(held && let_in == 0);
}

// ---- called by Paho's threads -------------------------------------------------------------------

void PahoConnection::on_success(const mqtt::token& token) noexcept {
  try {
    switch (token.get_type()) {
      case mqtt::token::CONNECT:
        if (connected_posted_.exchange(true)) return;  // Paho reports it twice
        end_of_connecting();
        setsockopt(last_socket_read(), IPPROTO_TCP, TCP_NODELAY, &kOn, sizeof(kOn));
        socket_.watch(last_socket_read());
        leave_out_idle_sleeps();  // this is the thread that reads the connection
        return post(connected_by(token));
      case mqtt::token::PUBLISH:
        return post(Delivered{id_of(token)});
      case mqtt::token::SUBSCRIBE:
        return post(subscribed(token, failure_text_));
      case mqtt::token::DISCONNECT:
        return post(Disconnected{});
      case mqtt::token::UNSUBSCRIBE:
        return;
    }
  } catch (...) {
    post_lost("out of memory in a callback");
  }
}

void PahoConnection::on_failure(const mqtt::token& token) noexcept {
  try {
    switch (token.get_type()) {
      case mqtt::token::CONNECT: {
        const std::string text = failure_text_.of_connect(token, connecting_since_);
        end_of_connecting();
        return post(ConnectFailed{text});
      }
      case mqtt::token::PUBLISH: {
        if (is_disconnected(token.get_return_code())) return post_lost(closed_text());
        return post(DeliveryFailed{id_of(token), failure_text_.refusal_of(token),
                                   failure_text_.of_publish(token)});
      }
      case mqtt::token::SUBSCRIBE:
        if (is_disconnected(token.get_return_code())) return post_lost(closed_text());
        return post(Subscribed{filter_of(token), false, failure_text_.of_subscribe(token)});
      case mqtt::token::DISCONNECT:
        return post(Disconnected{});
      case mqtt::token::UNSUBSCRIBE:
        return;
    }
  } catch (...) {
    post_lost("out of memory in a callback");
  }
}

void PahoConnection::connection_lost(const std::string& cause) noexcept {
  forget_tls_failure();
  try {
    post_lost(cause.empty() ? closed_text() : cause);
  } catch (...) {
    post_lost("connection closed");
  }
}

void PahoConnection::message_arrived(mqtt::const_message_ptr message) noexcept {
  try {
    Message event;
    event.received = std::chrono::steady_clock::now();
    event.received_ms = utc_now_ms();
    event.topic = message->get_topic();
    const bool is_config = event.topic.ends_with(kDesiredTopic);
    const std::size_t most = is_config ? std::max(max_payload_, kMaxDesiredBytes) : max_payload_;
    event.payload = message->get_payload_str().substr(0, most + 1);
    event.retained = message->is_retained();
    event.qos = message->get_qos();
    const mqtt::properties& properties = message->get_properties();
    using Code = mqtt::property::code;
    if (properties.contains(Code::RESPONSE_TOPIC))
      event.response_topic = mqtt::get<std::string>(properties, Code::RESPONSE_TOPIC);
    if (properties.contains(Code::CORRELATION_DATA)) {
      const auto data = mqtt::get<std::string>(properties, Code::CORRELATION_DATA);
      event.correlation.assign(data.begin(), data.end());
    }
    if (properties.contains(Code::MESSAGE_EXPIRY_INTERVAL))
      event.message_expiry =
          seconds(mqtt::get<std::uint32_t>(properties, Code::MESSAGE_EXPIRY_INTERVAL));
    std::size_t left = let_in_;
    if (left > 0 && let_in_.compare_exchange_strong(left, left - 1) && left == 1)
      socket_.pause(true);
    // Before the post, which wakes the uplink: read_on() ends the pause.
    if (inbox_->is_filling()) socket_.pause(true);
    post(std::move(event));
  } catch (...) {
    post_lost("out of memory in a callback");
  }
}

void PahoConnection::end_of_connecting() noexcept {
  if (!tls_) return;
  forget_tls_failure();
  trace_errors_alone();
}

}  // namespace fxagent
