#include "agent/history/subscriber.h"

#include <mqtt_protocol.h>
#include <openssl/ssl.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <stdexcept>

namespace fxagent::history {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kMisc{1000};          // interval of the library's own duties
constexpr std::size_t kMostBytes = std::size_t{4} << 20;  // of a batch; one message may exceed it
constexpr std::uint32_t kLargestMessage = 16 << 20;       // the broker discards larger ones
constexpr int kRefused = 0x80;                            // first reason code of a refusal

const char* text_or_null(const std::string& text) { return text.empty() ? nullptr : text.c_str(); }

Subscriber& self(void* object) { return *static_cast<Subscriber*>(object); }

void require(int status, const std::string& what) {
  if (status != MOSQ_ERR_SUCCESS)
    throw std::runtime_error(what + ": " + mosquitto_strerror(status));
}

}  // namespace

Subscriber::Subscriber(const SubscriberConfig& config, int stop) : config_(config), stop_(stop) {
  mosquitto_lib_init();
  client_.reset(mosquitto_new(config_.client_id.c_str(), /*clean_session=*/false, this));
  if (!client_) throw std::runtime_error("--client-id: " + config_.client_id + " is not usable");
  mosquitto* client = client_.get();
  // Nothing is sent until write(); see the top of the header.
  require(mosquitto_threaded_set(client, true), "libmosquitto");
  require(mosquitto_int_option(client, MOSQ_OPT_PROTOCOL_VERSION, MQTT_PROTOCOL_V5),
          "libmosquitto");
  require(mosquitto_int_option(client, MOSQ_OPT_RECEIVE_MAXIMUM, config_.receive_maximum),
          "--receive-maximum");
  if (!config_.username.empty())
    require(
        mosquitto_username_pw_set(client, config_.username.c_str(), text_or_null(config_.password)),
        "--username");
  if (config_.tls) {
    const bool own_ca = !config_.ca_file.empty();
    require(mosquitto_tls_set(client, text_or_null(config_.ca_file),
                              own_ca ? nullptr : "/etc/ssl/certs", text_or_null(config_.cert_file),
                              text_or_null(config_.key_file), nullptr),
            "--ca-file, --cert-file, --key-file");
  }
  mosquitto_connect_v5_callback_set(client, [](mosquitto*, void* object, int reason, int flags,
                                               const mosquitto_property* properties) {
    // Bit 0: session present (MQTT 5, section 3.2.2.1).
    self(object).on_connect(reason, (flags & 1) != 0, properties);
  });
  mosquitto_subscribe_v5_callback_set(
      client, [](mosquitto*, void* object, int, int count, const int* granted,
                 const mosquitto_property*) { self(object).on_subscribe(count, granted); });
  mosquitto_disconnect_v5_callback_set(
      client, [](mosquitto*, void* object, int reason, const mosquitto_property*) {
        self(object).on_disconnect(reason);
      });
  mosquitto_message_v5_callback_set(
      client,
      [](mosquitto*, void* object, const mosquitto_message* message, const mosquitto_property*) {
        self(object).messages_.push_back(
            {message->topic, std::string(static_cast<const char*>(message->payload),
                                         static_cast<std::size_t>(message->payloadlen))});
      });
}

Subscriber::~Subscriber() {
  client_.reset();
  mosquitto_lib_cleanup();
}

std::string Subscriber::connect() {
  connected_ = accepted_ = subscribed_ = between_packets_ = false;
  messages_.clear();
  fault_.clear();
  mosquitto_property* properties = nullptr;
  mosquitto_property_add_int32(&properties, MQTT_PROP_SESSION_EXPIRY_INTERVAL,
                               config_.session_expiry_s);
  mosquitto_property_add_int32(&properties, MQTT_PROP_MAXIMUM_PACKET_SIZE, kLargestMessage);
  const int status = mosquitto_connect_bind_v5(client_.get(), config_.host.c_str(), config_.port,
                                               config_.keep_alive_s,
                                               /*bind_address=*/nullptr, properties);
  const int system_error = errno;
  mosquitto_property_free_all(&properties);
  if (status == MOSQ_ERR_SUCCESS) {
    connected_ = true;
    return {};
  }
  return status == MOSQ_ERR_ERRNO ? std::generic_category().message(system_error)
                                  : mosquitto_strerror(status);
}

void Subscriber::on_connect(int reason, bool resumed, const mosquitto_property* properties) {
  if (reason != 0) {
    fault_ = std::string("the broker refuses the connection: ") + mosquitto_reason_string(reason);
    connected_ = false;
    return;
  }
  accepted_ = true;
  resumed_ = resumed;
  auto keep_alive_s = static_cast<std::uint16_t>(config_.keep_alive_s);
  // The broker may demand a shorter time. Leaves the value as it is if not.
  mosquitto_property_read_int16(properties, MQTT_PROP_SERVER_KEEP_ALIVE, &keep_alive_s,
                                /*skip_first=*/false);
  ping_interval_ = std::chrono::seconds(std::max(1, keep_alive_s / 3));
  next_ping_ = Clock::now() + ping_interval_;
  const std::string share = config_.group.empty() ? "" : "$share/" + config_.group + '/';
  // Health is not shared: a shared subscription gets no retained message, and the retained health
  // has the drops of an outage.
  std::array<std::string, 2> filters{share + config_.root + "/+/+/data/#",
                                     config_.root + "/+/health"};
  std::array<char*, 2> texts{filters[0].data(), filters[1].data()};
  check(mosquitto_subscribe_multiple(client_.get(), nullptr, 2, texts.data(), 1, 0, nullptr));
}

void Subscriber::on_subscribe(int count, const int* granted) {
  const int* refused =
      std::find_if(granted, granted + count, [](int code) { return code >= kRefused; });
  if (refused != granted + count) {
    fault_ =
        std::string("the broker refuses the subscription: ") + mosquitto_reason_string(*refused);
    connected_ = false;
    return;
  }
  subscribed_ = true;
}

void Subscriber::on_disconnect(int reason) {
  if (fault_.empty())
    fault_ = reason >= kRefused ? mosquitto_reason_string(reason) : mosquitto_strerror(reason);
  connected_ = false;
}

void Subscriber::check(int status) {
  if (status == MOSQ_ERR_SUCCESS) return;
  if (fault_.empty()) fault_ = mosquitto_strerror(status);
  connected_ = false;
}

void Subscriber::write() {
  if (!connected_) return;
  if (mosquitto_want_write(client_.get())) check(mosquitto_loop_write(client_.get(), 1));
  between_packets_ = !mosquitto_want_write(client_.get());
}

void Subscriber::keep_alive() {
  if (messages_.empty()) write();
  const auto now = Clock::now();
  if (!connected_ || !accepted_ || !between_packets_ || now < next_ping_) return;
  next_ping_ = now + ping_interval_;
  // The queue of libmosquitto begins with acknowledgements. So this packet goes past it.
  constexpr std::array<unsigned char, 2> kPingRequest{0xC0, 0};  // MQTT 5, section 3.12
  constexpr int kSize = kPingRequest.size();
  auto* tls = static_cast<SSL*>(mosquitto_ssl_get(client_.get()));
  const int socket = mosquitto_socket(client_.get());
  const bool is_sent = tls != nullptr ? SSL_write(tls, kPingRequest.data(), kSize) == kSize
                                      : send(socket, kPingRequest.data(), kSize,
                                             MSG_DONTWAIT | MSG_NOSIGNAL) == kSize;
  if (!is_sent) check(MOSQ_ERR_CONN_LOST);
}

/// Reads one packet, if one arrives within `wait`. Returns false if none did.
bool Subscriber::read_once(std::chrono::milliseconds wait) {
  const int socket = mosquitto_socket(client_.get());
  if (socket < 0) {
    check(MOSQ_ERR_CONN_LOST);
    return false;
  }
  auto* tls = static_cast<SSL*>(mosquitto_ssl_get(client_.get()));
  if (tls == nullptr || SSL_pending(tls) == 0) {
    // Waits for room only if nothing is unacknowledged: only then write() may be called.
    const bool writes = messages_.empty() && mosquitto_want_write(client_.get());
    pollfd waited[] = {{socket, static_cast<short>(writes ? POLLIN | POLLOUT : POLLIN), 0},
                       {stop_, POLLIN, 0}};
    poll(waited, 2, static_cast<int>(wait.count()));
    if ((waited[0].revents & ~POLLOUT) == 0) return false;
  }
  check(mosquitto_loop_read(client_.get(), 1));
  return connected_;
}

const std::vector<Message>& Subscriber::receive(std::chrono::milliseconds wait) {
  messages_.clear();
  write();
  if (!connected_) return messages_;
  std::size_t bytes = 0;
  std::size_t counted = 0;
  auto left = std::min(wait, kMisc);
  while (read_once(left)) {
    for (; counted < messages_.size(); ++counted) bytes += messages_[counted].payload.size();
    if (counted >= static_cast<std::size_t>(config_.receive_maximum) || bytes >= kMostBytes) break;
    // Takes what is there, and waits for nothing more.
    if (counted > 0)
      left = std::chrono::milliseconds(0);
    else
      write();
  }
  // After reading: an answer to keep_alive() may have waited. This queues packets and sends none.
  if (connected_) check(mosquitto_loop_misc(client_.get()));
  return messages_;
}

void Subscriber::acknowledge() {
  messages_.clear();
  write();
}

void Subscriber::disconnect() {
  if (!connected_) return;
  // A batch that was not committed: anything written now would carry its acknowledgements. The
  // socket is closed without a DISCONNECT, and the broker sends the batch again.
  if (!messages_.empty()) return;
  write();
  mosquitto_disconnect_v5(client_.get(), 0, nullptr);
  write();
}

}  // namespace fxagent::history
