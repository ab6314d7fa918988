#include "agent/uplink/paho/paho_broker.h"

#include <MQTTAsync.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <system_error>
#include <utility>

#include "agent/process/this_process.h"
#include "agent/uplink/paho/failure_text.h"
#include "agent/uplink/paho/paho_connection.h"
#include "agent/uplink/paho/paho_inbox.h"
#include "agent/uplink/paho/tls_files.h"

namespace fxagent {
namespace {

using std::chrono::seconds;

constexpr seconds kGoodbye{2};
constexpr seconds kCallbacksOver{1};  // our callbacks take microseconds

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

}  // namespace

PahoBroker::PahoBroker(const MqttConfig& config, MakeWill make_will, std::function<void()> notify,
                       std::size_t max_payload, seconds keep_session, const SettingNames& names)
    : config_(config),
      make_will_(std::move(make_will)),
      max_payload_(max_payload),
      // MQTT 3.1.1 has no expiry: the broker would keep the session of an ended program forever.
      keep_session_(config.version == 5 ? keep_session : seconds(0)),
      names_(names),
      inbox_(std::make_shared<PahoInbox>(std::move(notify))) {
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

void PahoBroker::found_closed() {
  if (!closed_since_) closed_since_ = std::chrono::steady_clock::now();
}

void PahoBroker::retire() {
  closed_since_.reset();
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
  retire();
  const std::uint64_t number = ++connections_;
  inbox_->begin(number);
  if (const std::string missing = missing_threads(); !missing.empty())
    return inbox_->post(number, ConnectFailed{missing});
  const auto password = read_password(config_);
  if (!password) return inbox_->post(number, ConnectFailed{password.error().text});
  if (config_.tls && is_tls(config_.servers.at(index)))
    if (const auto fault = fault_in(*config_.tls))  // names the faulty file, which OpenSSL does not
      return inbox_->post(number, ConnectFailed{std::string(fault->key) + " " + fault->text});
  try {
    connection_ = std::make_unique<PahoConnection>(
        inbox_, number, config_, config_.servers.at(index), max_payload_, keep_session_, names_);
    connection_->connect(make_will_ ? make_will_() : Publication{}, *password, receive_maximum);
  } catch (const std::exception& error) {
    inbox_->post(number, ConnectFailed{error.what()});
  }
}

void PahoBroker::disconnect(Will will) {
  if (!connection_ || !connection_->is_connected()) {
    retire();
    inbox_->begin(connections_);
    return inbox_->post(connections_, Disconnected{});
  }
  if (will == Will::published) {
    connection_->break_off();
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
    if (is_disconnected(error.get_return_code())) return found_closed();
    inbox_->post(connections_, DeliveryFailed{id, 0, error.what()});
  }
}

void PahoBroker::subscribe(Subscription subscription) {
  try {
    if (connection_) connection_->subscribe(subscription);
  } catch (const mqtt::exception& error) {
    if (is_disconnected(error.get_return_code())) return found_closed();
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

std::vector<BrokerEvent> PahoBroker::take_events() {
  // An attempt that was abandoned must not connect after all, beside its successor.
  const auto over = std::chrono::steady_clock::now() - kCallbacksOver;
  std::erase_if(retired_, [over](const Retired& retired) { return retired.since < over; });
  if (closed_since_ && *closed_since_ < over) connection_->post_lost("found closed");
  auto events = inbox_->take();
  if (connection_) connection_->read_on();
  return events;
}

}  // namespace fxagent
