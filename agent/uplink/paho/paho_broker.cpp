#include "agent/uplink/paho/paho_broker.h"

#include <mqtt/async_client.h>
#include <netdb.h>
#include <openssl/err.h>
#include <openssl/x509_vfy.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>

#include "agent/log/log.h"
#include "agent/process/startup.h"
#include "agent/uplink/paho/connect_faults.h"
#include "agent/uplink/paho/idle_sleep.h"
#include "agent/uplink/paho/incoming_packets.h"
#include "agent/uplink/paho/packet_guard.h"
#include "agent/uplink/paho/read_pause.h"
#include "agent/uplink/paho/send_at_once.h"
#include "agent/uplink/paho/tls_files.h"
#include "agent/uplink/paho/tls_read_bound.h"

namespace fxagent {
namespace {

using std::chrono::seconds;

constexpr seconds kConnectTimeout{10};
constexpr seconds kGoodbye{2};
constexpr seconds kCallbacksOver{1};  // our callbacks take microseconds
// Far above the publisher's window: Paho throws when its buffer is full, connected or not.
constexpr int kPahoBuffer = 10000;
constexpr int kPahoInFlight = 1000;  // above the publisher's window, so that Paho never queues
constexpr std::size_t kMaxInboxBytes = std::size_t{64} << 20;
// Size of the inbox above which QoS 0 messages are dropped. The broker sends them without flow
// control and never repeats them.
constexpr std::size_t kMaxUnaskedBytes = std::size_t{4} << 20;

bool is_tls(std::string_view server) { return server.starts_with("mqtts://"); }

/// Converts the server's scheme to those that Paho 1.2 supports best.
std::string paho_uri(std::string_view server) {
  constexpr std::string_view plain = "mqtt://";
  constexpr std::string_view tls = "mqtts://";
  if (server.starts_with(tls)) return "ssl://" + std::string(server.substr(tls.size()));
  if (server.starts_with(plain)) return "tcp://" + std::string(server.substr(plain.size()));
  return std::string(server);
}

/// Keeps Paho from filling OpenSSL's tables of ciphers and error texts, because most plants have no
/// TLS. OpenSSL fills them on its own when needed.
void leave_openssl_alone() {
  MQTTAsync_init_options options = MQTTAsync_init_options_initializer;
  options.do_openssl_init = 0;
  MQTTAsync_global_init(&options);
}

constexpr int kPahoThreads = 2;

/// True if Paho's threads are running, or if that cannot be determined.
bool paho_runs() {
  std::error_code fault;
  int found = 0;
  const std::filesystem::directory_iterator tasks("/proc/self/task", fault);
  if (fault) return true;
  for (const auto& task : tasks) {
    std::ifstream comm(task.path() / "comm");
    std::string name;
    if (std::getline(comm, name) && name.starts_with("MQTTAsync_")) ++found;
  }
  return found >= kPahoThreads;
}

/// Returns why Paho's threads cannot be started; empty: they run or can be started. Paho starts
/// them with its first connection and does not check for failure: it would wait forever for a
/// thread that is missing.
std::string missing_threads() { return paho_runs() ? std::string() : lacks(kPahoThreads, 0); }

constexpr std::size_t kMaxPassword = 65535;  // MQTT 5, section 3.1.3.6

/// Returns the password, if there is one; bad_request if it cannot be read.
Result<std::optional<std::string>> read_password(const MqttConfig& config) {
  if (!config.password_file.empty()) {
    errno = 0;
    std::ifstream file(config.password_file, std::ios::binary);
    std::string text(kMaxPassword + 1, '\0');
    file.read(text.data(), static_cast<std::streamsize>(text.size()));
    text.resize(static_cast<std::size_t>(file.gcount()));
    if (text.size() > kMaxPassword)
      return fail(ErrorCode::bad_request,
                  "password_file " + config.password_file + ": longer than a password can be");
    if (!file.is_open() || file.bad())
      return fail(ErrorCode::bad_request, "password_file " + config.password_file + ": " +
                                              (errno != 0 ? std::strerror(errno) : "unreadable"));
    if (text.ends_with('\n')) text.pop_back();
    if (text.ends_with('\r')) text.pop_back();
    return text;
  }
  if (!config.password_env.empty()) {
    const char* value = std::getenv(config.password_env.c_str());
    if (value == nullptr)
      return fail(ErrorCode::bad_request,
                  "environment variable " + config.password_env + " is not set");
    return std::string(value);
  }
  if (!config.password.empty()) return config.password;
  return std::nullopt;
}

/// Names the faulty file, which OpenSSL does not.
Result<void> check_tls_files(const TlsSettings& tls) {
  const auto fault = fault_in(tls);
  if (fault) return fail(ErrorCode::bad_request, std::string(fault->key) + " " + fault->text);
  return {};
}

/// Reason of a TLS failure on this Paho thread; empty: none recorded. Paho's own error handler
/// cannot be used: in C++ 1.2 it gets a pointer to options that are destroyed when connect()
/// returns. OpenSSL's list of errors is overwritten before on_failure() is called. But Paho traces
/// a failed TLS call at once, on the same thread, while the list still contains the cause.
thread_local std::string tls_reason;
/// Beginning of the reason if Paho traced a number and OpenSSL has no text for it.
constexpr std::string_view kNoWords = "SSLSocket error";

void note_tls_reason(enum MQTTASYNC_TRACE_LEVELS, char* message) noexcept {
  std::string_view text = message != nullptr ? message : "";
  const std::size_t at = text.find(kNoWords);
  if (at == std::string_view::npos || text.find("WANT_READ") != std::string_view::npos) return;
  text.remove_prefix(at);
  while (text.ends_with('\n')) text.remove_suffix(1);
  const unsigned long code = ERR_peek_error();
  const char* words = code == 0 ? nullptr : ERR_reason_error_string(code);
  try {
    tls_reason = words != nullptr ? std::string_view(words) : text;
  } catch (...) {
    tls_reason.clear();
  }
}

/// Limits Paho's trace to errors. By default Paho records each of its function calls and packets in
/// a list in memory that is never read, which is a sixth of its cost per message. Levels above
/// ERROR would not prevent it.
void trace_errors_alone() noexcept { MQTTAsync_setTraceLevel(MQTTASYNC_TRACE_ERROR); }

std::string reason_text(int code) {
  const char* text = MQTTReasonCode_toString(static_cast<MQTTReasonCodes>(code));
  return text != nullptr ? text : "reason " + std::to_string(code);
}

/// Describes a broker's DISCONNECT.
std::string disconnect_text(const mqtt::properties& properties, int code) {
  std::string text = "the broker said: " + (code == 0 ? "normal disconnection" : reason_text(code));
  if (code == kSessionTakenOver)
    text +=
        " (another client connected with this agent's client id: give each its own agent.id or "
        "mqtt.client_id)";
  using Code = mqtt::property::code;
  if (properties.contains(Code::REASON_STRING))
    text += ": " + log::excerpt(mqtt::get<std::string>(properties, Code::REASON_STRING));
  return text;
}

/// True if Paho ended a call because the connection is gone.
bool is_disconnected(int return_code) {
  return return_code == MQTTASYNC_DISCONNECTED || return_code == MQTTASYNC_OPERATION_INCOMPLETE;
}

/// CONNACK return codes of MQTT 3.1.1, section 3.2.2.3.
std::string_view connack_text(int code) {
  switch (code) {
    case 1:
      return "the broker does not support this MQTT version";
    case 2:
      return "client identifier rejected";
    case 3:
      return "server unavailable";
    case 4:
      return "bad user name or password";
    case 5:
      return "not authorized";
    default:
      return "";
  }
}

constexpr std::string_view kAccessCure =
    ": its access rules do not allow this for the agent's user; fxagent acl prints the rules that "
    "the agent needs";

/// Returns advice on the refusal of a topic; empty: none.
std::string_view cure_of_access(int code) {
  return code == MQTTREASONCODE_NOT_AUTHORIZED ? kAccessCure : std::string_view();
}

/// Returns advice on the refusal of a CONNECT, of MQTT 5 or 3.1.1; empty: none.
std::string_view cure_of_refusal(int code, const MqttConfig& config) {
  switch (code) {
    case 1:
      return ": set mqtt.version to 3.1.1 or 5";
    case MQTTREASONCODE_UNSUPPORTED_PROTOCOL_VERSION:
      return ": set mqtt.version to 3.1.1";
    case 2:
    case MQTTREASONCODE_CLIENT_IDENTIFIER_NOT_VALID:
      return ": set mqtt.client_id to one that the broker accepts";
    case 4:
    case 5:
    case MQTTREASONCODE_BAD_USER_NAME_OR_PASSWORD:
    case MQTTREASONCODE_NOT_AUTHORIZED:
      return config.username.empty()
                 ? ": the broker requires a user: set mqtt.username and password_file"
                 : ": the broker does not accept mqtt.username with this password: compare both "
                   "with the broker's password file";
    case 3:
    case MQTTREASONCODE_SERVER_UNAVAILABLE:
    case MQTTREASONCODE_SERVER_BUSY:
      return ": the broker refuses connections for now; the agent retries. See the broker's log";
    case MQTTREASONCODE_BANNED:
      return ": the broker has banned this client: remove it from the broker's ban list (by client "
             "id, user or address)";
    case MQTTREASONCODE_PACKET_TOO_LARGE:
      return ": the agent's last will is larger than the broker's maximum packet size: raise that";
    case MQTTREASONCODE_QUOTA_EXCEEDED:
      return ": the broker's limit for this user or for all clients is reached: raise it, or stop "
             "unneeded clients";
    case MQTTREASONCODE_USE_ANOTHER_SERVER:
    case MQTTREASONCODE_SERVER_MOVED:
      return ": the broker refers its clients to another server: put that address into "
             "mqtt.servers";
    case MQTTREASONCODE_CONNECTION_RATE_EXCEEDED:
      return ": too many connections in a short time; the agent retries. If this persists, raise "
             "the broker's limit";
    default:
      return {};
  }
}

/// Returns why the server's certificate was not accepted, and what to do.
std::string distrust(long code, const MqttConfig& config) {
  std::string text =
      std::string("TLS: certificate verify failed: ") + X509_verify_cert_error_string(code);
  if (code == X509_V_ERR_CERT_HAS_EXPIRED || code == X509_V_ERR_CERT_NOT_YET_VALID)
    return text + ": renew it, or set this machine's clock";
  const bool own = config.tls && !config.tls->ca_file.empty();
  return text +
         (own ? ": mqtt.tls.ca_file " + config.tls->ca_file +
                    " does not contain the authority that signed the server's certificate"
              : ": set mqtt.tls.ca_file to the authority that signed the server's certificate");
}

mqtt::property number_property(mqtt::property::code code, std::uint32_t value) {
  return {code, static_cast<std::int32_t>(value)};
}

}  // namespace

// ---- inbox --------------------------------------------------------------------------------------

/// Events from Paho's threads to the uplink thread. Any thread. Bounded: excess messages are
/// dropped and counted; every other event comes at most once per call of ours.
class PahoBroker::Inbox final {
 public:
  explicit Inbox(std::function<void()> notify) : notify_(std::move(notify)) {}

  /// Discards all waiting events. Accepts only events of this connection afterwards.
  void begin(std::uint64_t connection) {
    const std::lock_guard lock(mutex_);
    connection_ = connection;
    events_.clear();
    bytes_ = 0;
    dropped_ = 0;
  }

  /// Sets whether Delivered calls notify(). When switched on, notifies at once if events are
  /// waiting.
  void await_acknowledgements(bool awaited) {
    {
      const std::lock_guard lock(mutex_);
      if (std::exchange(acknowledgements_awaited_, awaited) || !awaited || events_.empty()) return;
    }
    notify_();
  }

  void post(std::uint64_t connection, BrokerEvent event) {
    {
      const std::lock_guard lock(mutex_);
      if (connection != connection_) return;
      if (const auto* message = std::get_if<Message>(&event)) {
        const std::size_t size = bytes_of(*message);
        if (bytes_ + size > (message->qos == 0 ? kMaxUnaskedBytes : kMaxInboxBytes)) {
          ++dropped_;
          return;
        }
        bytes_ += size;
      }
      const bool quiet = !acknowledgements_awaited_ && std::holds_alternative<Delivered>(event);
      events_.push_back(std::move(event));
      if (quiet) return;
    }
    notify_();
  }

  std::vector<BrokerEvent> take() {
    const std::lock_guard lock(mutex_);
    if (dropped_ != 0) events_.emplace_back(MessagesDropped{std::exchange(dropped_, 0)});
    bytes_ = 0;
    return std::exchange(events_, {});
  }

 private:
  const std::function<void()> notify_;
  std::mutex mutex_;
  std::uint64_t connection_ = 0;
  std::vector<BrokerEvent> events_;
  std::size_t bytes_ = 0;
  std::uint64_t dropped_ = 0;
  bool acknowledgements_awaited_ = true;
};

// ---- connection ---------------------------------------------------------------------------------

/// One Paho client and the receiver of its callbacks. Callbacks copy, post and return: a wait
/// inside a callback would block Paho for good.
class PahoBroker::Connection final : public virtual mqtt::callback,
                                     public virtual mqtt::iaction_listener {
 public:
  Connection(std::shared_ptr<Inbox> inbox, std::uint64_t number, const MqttConfig& config,
             const std::string& server, std::size_t max_payload, seconds keep_session)
      : inbox_(std::move(inbox)),
        number_(number),
        config_(config),
        max_payload_(max_payload),
        keep_session_(keep_session),
        version_(config.version == 5 ? MQTTVERSION_5 : MQTTVERSION_3_1_1),
        tls_(is_tls(server)),
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

  void connect(const MqttConfig& config, const std::optional<Will>& will,
               const std::optional<std::string>& password, std::uint16_t receive_maximum) {
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
    options.set_keep_alive_interval(config.keep_alive);
    options.set_connect_timeout(kConnectTimeout);
    options.set_automatic_reconnect(false);
    options.set_max_inflight(kPahoInFlight);
    if (!config.username.empty()) options.set_user_name(config.username);
    if (password) options.set_password(mqtt::binary_ref(*password));
    if (will)
      options.set_will_message(
          mqtt::message(will->topic, will->payload, 1, will->retain == Retain::yes));
    if (tls_) {
      MQTTAsync_setTraceCallback(note_tls_reason);
      MQTTAsync_setTraceLevel(MQTTASYNC_TRACE_MINIMUM);  // until the outcome is known
      mqtt::ssl_options_builder tls;
      tls.enable_server_cert_auth(true).verify(true);
      if (config.tls) {
        if (!config.tls->ca_file.empty()) tls.trust_store(config.tls->ca_file);
        if (!config.tls->cert_file.empty()) tls.key_store(config.tls->cert_file);
        if (!config.tls->key_file.empty()) tls.private_key(config.tls->key_file);
      }
      options.set_ssl(tls.finalize());
    }
    connecting_since_ = std::chrono::steady_clock::now();
    client_.connect(options, nullptr, *this);
  }

  /// Starts a clean disconnect; its token is complete when the DISCONNECT has been sent.
  mqtt::token_ptr disconnect() {
    leaving_ = true;
    pause_.set(false);
    return client_.disconnect(0, nullptr, *this);
  }

  bool is_connected() const { return client_.is_connected(); }
  bool is_leaving() const { return leaving_; }

  void publish(Publication publication) {
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

  void subscribe(const Subscription& subscription) {
    mqtt::subscribe_options options;
    if (version_ == MQTTVERSION_5) {
      options.set_no_local(subscription.no_local);
      options.set_retain_as_published(true);
    }
    client_.subscribe(subscription.filter, 1, nullptr, *this, options);
  }

  void unsubscribe(const std::string& filter) { client_.unsubscribe(filter, nullptr, *this); }

  /// Posts the loss of the connection once, whichever thread detects it first. Any thread.
  void post_lost(std::string_view text, int reason_code = 0) noexcept {
    if (leaving_) return;  // the end of our own disconnect; Disconnected reports it
    if (lost_.exchange(true)) return;
    try {
      post(Lost{std::string(text), reason_code});
    } catch (...) {
      lost_ = false;  // out of memory; the next failure reports the loss again
    }
  }

  /// Paho acknowledges a message when its callback has returned, and calls it under the lock that
  /// each publish() takes. So a callback must not wait; to hold messages back, the socket is not
  /// read.
  void hold_messages(bool held, std::size_t let_in) noexcept {
    let_in_ = held ? let_in : 0;
    pause_.set(held && let_in == 0);
  }

 private:
  void post(BrokerEvent event) { inbox_->post(number_, std::move(event)); }

  // Called by Paho's threads.
  void on_success(const mqtt::token& token) noexcept override {
    try {
      switch (token.get_type()) {
        case mqtt::token::CONNECT:
          if (connected_posted_.exchange(true)) return;  // Paho reports it twice
          end_of_connecting();
          send_at_once(last_socket_read());
          pause_.watch(last_socket_read());
          leave_out_idle_sleeps();  // this is the thread that reads the connection
          return post(connected_by(token));
        case mqtt::token::PUBLISH:
          return post(Delivered{id_of(token)});
        case mqtt::token::SUBSCRIBE:
          return post(subscribed(token));
        case mqtt::token::DISCONNECT:
          return post(Disconnected{});
        case mqtt::token::UNSUBSCRIBE:
          return;
      }
    } catch (...) {
      post_lost("out of memory in a callback");
    }
  }

  void on_failure(const mqtt::token& token) noexcept override {
    try {
      switch (token.get_type()) {
        case mqtt::token::CONNECT: {
          const std::string text = connect_failure(token);
          end_of_connecting();
          return post(ConnectFailed{text});
        }
        case mqtt::token::PUBLISH: {
          if (is_disconnected(token.get_return_code())) return post_lost(why_closed());
          return post(DeliveryFailed{id_of(token), refusal_of(token), failure_text(token)});
        }
        case mqtt::token::SUBSCRIBE:
          if (is_disconnected(token.get_return_code())) return post_lost(why_closed());
          return post(Subscribed{filter_of(token), false, subscribe_failure(token)});
        case mqtt::token::DISCONNECT:
          return post(Disconnected{});
        case mqtt::token::UNSUBSCRIBE:
          return;
      }
    } catch (...) {
      post_lost("out of memory in a callback");
    }
  }

  void connection_lost(const std::string& cause) noexcept override {
    tls_reason.clear();  // otherwise the next failed connect would give it as its reason
    try {
      post_lost(cause.empty() ? why_closed() : cause);
    } catch (...) {
      post_lost("connection closed");
    }
  }

  void message_arrived(mqtt::const_message_ptr message) noexcept override {
    try {
      Message event;
      event.received = std::chrono::steady_clock::now();
      event.received_ms = utc_ms(std::chrono::system_clock::now());
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
        pause_.set(true);
      post(std::move(event));
    } catch (...) {
      post_lost("out of memory in a callback");
    }
  }

  /// Describes a packet that was rejected; empty: there was none.
  static std::string refused_packet() {
    const RefusedPacket refused = take_refused_packet();
    if (refused.bytes == 0) return {};
    if (refused.most == 0) return "the server sent a message before its answer to CONNECT";
    return "the broker sent a packet of " + std::to_string(refused.bytes) +
           " bytes; the agent reads at most " + std::to_string(refused.most);
  }

  /// Call on the thread that found the connection closed.
  static std::string why_closed() {
    if (std::string refused = refused_packet(); !refused.empty()) return refused;
    return "connection closed: the broker was stopped, the network failed, or another client "
           "connected with this agent's client id (each needs its own agent.id or mqtt.client_id)";
  }

  Connected connected_by(const mqtt::token& token) const {
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

  Subscribed subscribed(const mqtt::token& token) const {
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
      event.text = reason_text(code).append(cure_of_access(code));
    else
      event.text = "a SUBACK that does not match the request";
    return event;
  }

  void end_of_connecting() noexcept {
    if (!tls_) return;
    tls_reason.clear();
    trace_errors_alone();
  }

  /// Returns the MQTT 5 reason code of a refusal; 0 if it is not the broker's. Paho puts the code
  /// of a CONNACK into the return code, any other into the reason code.
  int refusal_of(const mqtt::token& token) const {
    if (version_ != MQTTVERSION_5) return 0;
    const int reason = static_cast<int>(token.get_reason_code());
    if (reason >= 0x80) return reason;
    const int code = token.get_return_code();
    return code >= 0x80 ? code : 0;
  }

  std::string connect_failure(const mqtt::token& token) const {
    if (const int reason = refusal_of(token))
      return reason_text(reason).append(cure_of_refusal(reason, config_));
    const int code = token.get_return_code();
    const std::string_view refusal = connack_text(code);
    if (!refusal.empty()) return std::string(refusal).append(cure_of_refusal(code, config_));
    if (std::string refused = refused_packet(); !refused.empty()) return refused;
    const ConnectFaults faults = connect_faults(connecting_since_);
    if (faults.lookup != 0)
      return std::string("the host name is not known (") + gai_strerror(faults.lookup) +
             "): is it spelt correctly, and does this machine's name server know it?";
    if (faults.socket == ECONNREFUSED)
      return "connection refused: is the broker running, and is this its port?";
    if (faults.socket != 0)
      return std::string("no way to this address (") + std::strerror(faults.socket) +
             "): is the network up, and is the address right?";
    return tls_ ? tls_failure(faults) : plain_failure(faults);
  }

  std::string tls_failure(const ConnectFaults& faults) const {
    if (faults.certificate != X509_V_OK) return distrust(faults.certificate, config_);
    if (faults.handshake_endless)
      return "the server's TLS handshake does not end within " + std::to_string(kMaxHandshake) +
             " bytes: is this the broker's port?";
    if (faults.handshake_cut)
      return "the server ends the TLS handshake, as a port without TLS does: try mqtt://, or the "
             "port with TLS";
    if (faults.other_host)
      return "TLS: the server's certificate is not for this host name: use a host name that is in "
             "the certificate, or have it issued for this one";
    if (!tls_reason.empty() && !tls_reason.starts_with(kNoWords))
      return "TLS: " + tls_reason +
             (tls_reason.find("certificate required") == std::string::npos
                  ? ""
                  : ": set mqtt.tls.cert_file and key_file");
    if (!faults.is_encrypted) return tls_reason.empty() ? kNoAnswer : "TLS: " + tls_reason;
    return std::chrono::steady_clock::now() - connecting_since_ < kConnectTimeout
               ? cut_after_handshake()
               : kNoAnswer;
  }

  std::string cut_after_handshake() const {
    const std::string text = "the server ends the connection after the TLS handshake: ";
    const bool has_own = config_.tls && !config_.tls->cert_file.empty();
    return has_own ? text +
                         "it may not accept the certificate of mqtt.tls.cert_file: is it still "
                         "valid, and does the broker trust its authority?"
                   : text + "it may require a certificate: set mqtt.tls.cert_file and key_file";
  }

  std::string plain_failure(const ConnectFaults& faults) const {
    if (last_closed_by_peer() < connecting_since_ && !faults.speaks_tls) return kNoAnswer;
    if (faults.speaks_tls)
      return "the server answers with TLS: try mqtts://, or the port without TLS";
    if (faults.was_reset)
      return "the server closes the connection before any MQTT packet: is this a broker's port, "
             "and does the broker accept this machine's address? If it is a port with TLS, try "
             "mqtts://";
    const std::string closed = "the server accepts the connection and closes it without an answer";
    return version_ == MQTTVERSION_5
               ? closed + "; a broker without MQTT 5 does so: try \"version\": \"3.1.1\""
               : closed + ": is it an MQTT broker?";
  }

  std::string failure_text(const mqtt::token& token) const {
    if (const int reason = refusal_of(token))
      return reason_text(reason).append(cure_of_access(reason));
    const std::string text = mqtt::exception::error_str(token.get_return_code());
    return text.empty() ? "code " + std::to_string(token.get_return_code()) : text;
  }

  std::string subscribe_failure(const mqtt::token& token) const {
    // The only failure code that MQTT 3.1.1 has, section 3.9.3; Paho has no text for it.
    if (version_ != MQTTVERSION_5 && token.get_return_code() == 0x80)
      return std::string("refused by the broker").append(kAccessCure);
    return failure_text(token);
  }

  static constexpr const char* kNoAnswer =
      "no answer from this address: is it the broker's, and does every firewall allow the port?";

  static std::uint64_t id_of(const mqtt::token& token) {
    return reinterpret_cast<std::uint64_t>(token.get_user_context());
  }

  static std::string filter_of(const mqtt::token& token) {
    const auto topics = token.get_topics();
    return topics && !topics->empty() ? (*topics)[0] : std::string();
  }

  const std::shared_ptr<Inbox> inbox_;
  const std::uint64_t number_;
  const MqttConfig config_;  ///< own copy, which Paho's threads may read at any time
  const std::size_t max_payload_;
  const seconds keep_session_;  ///< 0: each connection has a session of its own
  const int version_;
  const bool tls_;
  std::chrono::steady_clock::time_point connecting_since_{};  ///< set before Paho can call back
  ReadPause pause_;
  std::atomic<std::size_t> let_in_ = 0;  ///< messages before the pause
  std::atomic<bool> connected_posted_ = false;
  std::atomic<bool> leaving_ = false;
  std::atomic<bool> lost_ = false;
  mqtt::async_client client_;  ///< last member: destroyed before what its callbacks use
};

// ---- broker -------------------------------------------------------------------------------------

PahoBroker::PahoBroker(const MqttConfig& config, MakeWill make_will, std::function<void()> notify,
                       std::size_t max_payload, seconds keep_session)
    : config_(config),
      make_will_(std::move(make_will)),
      max_payload_(max_payload),
      // MQTT 3.1.1 has no expiry: the broker would keep the session of an ended program forever.
      keep_session_(config.version == 5 ? keep_session : seconds(0)),
      inbox_(std::make_shared<Inbox>(std::move(notify))) {
  static std::once_flag once;
  std::call_once(once, leave_openssl_alone);
}

PahoBroker::~PahoBroker() {
  inbox_->begin(0);
  // A broker that did not answer a disconnect in time is not asked again.
  if (!connection_ || !connection_->is_connected() || connection_->is_leaving()) return;
  try {
    connection_->disconnect()->wait_for(kGoodbye);
  } catch (const mqtt::exception&) {
    // Already closing: the client's destructor closes the rest.
  }
}

void PahoBroker::retire() {
  if (!connection_) return;
  inbox_->begin(0);
  if (connection_->is_connected()) {
    try {
      connection_->disconnect();
    } catch (const mqtt::exception&) {
      // The connection was lost just now, which has the same effect.
    }
  }
  retired_.push_back({std::move(connection_), std::chrono::steady_clock::now()});
}

void PahoBroker::connect(std::size_t index, std::uint16_t receive_maximum) {
  const auto over = std::chrono::steady_clock::now() - kCallbacksOver;
  std::erase_if(retired_, [over](const Retired& retired) { return retired.since < over; });
  retire();
  const std::uint64_t number = ++connections_;
  inbox_->begin(number);
  if (const std::string missing = missing_threads(); !missing.empty())
    return inbox_->post(number, ConnectFailed{missing});
  const auto password = read_password(config_);
  if (!password) return inbox_->post(number, ConnectFailed{password.error().text});
  if (config_.tls && is_tls(config_.servers.at(index))) {
    const auto readable = check_tls_files(*config_.tls);
    if (!readable) return inbox_->post(number, ConnectFailed{readable.error().text});
  }
  try {
    connection_ = std::make_unique<Connection>(inbox_, number, config_, config_.servers.at(index),
                                               max_payload_, keep_session_);
    std::optional<Will> will;
    if (make_will_) will = make_will_();
    connection_->connect(config_, will, *password, receive_maximum);
  } catch (const std::exception& error) {
    inbox_->post(number, ConnectFailed{error.what()});
  }
}

void PahoBroker::disconnect() {
  if (!connection_ || !connection_->is_connected()) {
    retire();
    inbox_->begin(connections_);
    return inbox_->post(connections_, Disconnected{});
  }
  try {
    connection_->disconnect();
  } catch (const mqtt::exception&) {
    inbox_->post(connections_, Disconnected{});
  }
}

bool PahoBroker::is_connected() const { return connection_ && connection_->is_connected(); }

void PahoBroker::publish(Publication publication) {
  const std::uint64_t id = publication.id;
  try {
    if (connection_) connection_->publish(std::move(publication));
  } catch (const mqtt::exception& error) {
    if (is_disconnected(error.get_return_code()))
      return connection_->post_lost("disconnected before the message was published");
    inbox_->post(connections_, DeliveryFailed{id, 0, error.what()});
  }
}

void PahoBroker::subscribe(Subscription subscription) {
  try {
    if (connection_) connection_->subscribe(subscription);
  } catch (const mqtt::exception& error) {
    if (is_disconnected(error.get_return_code()))
      return connection_->post_lost("disconnected before the subscription");
    inbox_->post(connections_, Subscribed{subscription.filter, false, error.what()});
  }
}

void PahoBroker::unsubscribe(const std::string& filter) {
  try {
    if (connection_) connection_->unsubscribe(filter);
  } catch (const mqtt::exception&) {
    // The connection is closing, and the subscription with it.
  }
}

void PahoBroker::await_acknowledgements(bool awaited) { inbox_->await_acknowledgements(awaited); }

void PahoBroker::hold_messages(bool held, std::size_t let_in) {
  if (connection_) connection_->hold_messages(held, let_in);
}

std::vector<BrokerEvent> PahoBroker::take_events() { return inbox_->take(); }

}  // namespace fxagent
