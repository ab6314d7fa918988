// One connection to a broker: a Paho client, the calls to it, and its callbacks as events.
#pragma once

#include <mqtt/async_client.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "agent/config/model.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/paho/failure_text.h"
#include "agent/uplink/paho/paho_inbox.h"

namespace fxagent {

/// The socket of a TCP connection that a library owns. Has no effect on a socket that has been
/// closed since, even if its number is in use again, nor on systems without SO_COOKIE, socket(7).
/// Any thread.
class BorrowedSocket final {
 public:
  /// Selects the socket; -1: none.
  void watch(int fd) noexcept;
  /// Backpressure: makes the socket count as unreadable, so that the library's thread waits in
  /// poll() and holds none of its locks. What the peer sends stays in the kernel, then in the peer.
  /// A few more bytes may be read: those that the kernel has no room for, and those that TLS has
  /// already decrypted. Uses SO_RCVLOWAT, socket(7); has no effect on systems without this option.
  void pause(bool paused) noexcept;
  /// Ends the connection in both directions.
  void shut_down() noexcept;

 private:
  void apply() noexcept;

  std::mutex mutex_;
  int fd_ = -1;
  std::uint64_t cookie_ = 0;  ///< the kernel's own id of the socket, never used again; 0: none
  bool paused_ = false;
};

/// Uplink thread; Paho's threads call only the callbacks. Callbacks copy, post and return: a wait
/// inside a callback would block Paho for good. A call throws mqtt::exception if Paho rejects it.
class PahoConnection final : public virtual mqtt::callback, public virtual mqtt::iaction_listener {
 public:
  /// Makes the client; connect() opens the connection. The connection posts its events to `inbox`
  /// as those of connection `number`. `inbox` is shared, because a callback may still run after the
  /// connection has been retired. `keep_session` is 0 if each connection has a session of its own.
  PahoConnection(std::shared_ptr<PahoInbox> inbox, std::uint64_t number, const MqttConfig& config,
                 const std::string& server, std::size_t max_payload,
                 std::chrono::seconds keep_session, const SettingNames& names);

  /// Posts Connected or ConnectFailed. Call once. `will` as from MakeWill.
  void connect(const Publication& will, const std::optional<std::string>& password,
               std::uint16_t receive_maximum);
  /// Starts a clean disconnect; its token is complete when the DISCONNECT has been sent.
  mqtt::token_ptr disconnect();
  /// Ends the TCP connection, which Paho then finds closed: it has no way to leave without a
  /// DISCONNECT. What has arrived by then may still be posted, but no Lost.
  void break_off() noexcept;
  bool is_connected() const { return !broken_off_ && client_.is_connected(); }
  /// True after disconnect() and break_off().
  bool is_leaving() const { return leaving_; }

  void publish(Publication publication);
  void subscribe(const Subscription& subscription);
  void unsubscribe(const std::string& filter) { client_.unsubscribe(filter, nullptr, *this); }

  /// Posts the loss of the connection once, whichever thread detects it first. Any thread.
  void post_lost(std::string_view text, int reason_code = 0) noexcept;

  /// Paho acknowledges a message before it calls the callback, and calls it under the lock that
  /// each publish() takes. So a callback must not wait; to hold messages back, the socket is not
  /// read. After disconnect(), what is held stays held.
  void hold_messages(bool held, std::size_t let_in) noexcept;
  /// The inbox is empty: reads on after a burst that filled it, unless messages are held.
  void read_on() noexcept {
    if (!held_ && !leaving_) socket_.pause(false);
  }

 private:
  void post(BrokerEvent event) { inbox_->post(number_, std::move(event)); }
  void end_of_connecting() noexcept;

  // Called by Paho's threads.
  void on_success(const mqtt::token& token) noexcept override;
  void on_failure(const mqtt::token& token) noexcept override;
  void connection_lost(const std::string& cause) noexcept override;
  void message_arrived(mqtt::const_message_ptr message) noexcept override;

  const std::shared_ptr<PahoInbox> inbox_;
  const std::uint64_t number_;
  const MqttConfig config_;  ///< own copy, which Paho's threads may read at any time
  const std::size_t max_payload_;
  const std::chrono::seconds keep_session_;
  const int version_;
  const bool tls_;
  const FailureText failure_text_;
  std::chrono::steady_clock::time_point connecting_since_{};  ///< set before Paho can call back
  BorrowedSocket socket_;
  std::atomic<std::size_t> let_in_ = 0;  ///< messages before the pause
  std::atomic<bool> connected_posted_ = false;
  std::atomic<bool> leaving_ = false;
  bool held_ = false;        ///< of the uplink's thread
  bool broken_off_ = false;  ///< of the uplink's thread
  std::atomic<bool> lost_ = false;
  mqtt::async_client client_;  ///< last member: destroyed before what its callbacks use
};

/// True if the server's scheme is that of MQTT over TLS.
bool is_tls(std::string_view server);

}  // namespace fxagent
