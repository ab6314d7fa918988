#include "agent/uplink/paho/failure_text.h"

#include <MQTTAsync.h>
#include <mqtt/exception.h>
#include <netdb.h>
#include <openssl/err.h>
#include <openssl/x509_vfy.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <string_view>

#include "agent/log/log.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/paho/incoming_packets.h"
#include "agent/uplink/paho/socket_calls.h"

namespace fxagent {
namespace {

constexpr const char* kNoAnswer =
    "no answer from this address: is it the broker's, and does every firewall allow the port?";

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

std::string reason_text(int code) {
  const char* text = MQTTReasonCode_toString(static_cast<MQTTReasonCodes>(code));
  return text != nullptr ? text : "reason " + std::to_string(code);
}

/// CONNACK return codes of MQTT 3.1.1, section 3.2.2.3; empty: the code is none of them.
std::string_view connack_text(int code) {
  constexpr std::array<std::string_view, 6> kTexts{"",
                                                   "the broker does not support this MQTT version",
                                                   "client identifier rejected",
                                                   "server unavailable",
                                                   "bad user name or password",
                                                   "not authorized"};
  return code > 0 && code < std::ssize(kTexts) ? kTexts[static_cast<std::size_t>(code)] : "";
}

/// Returns advice on the refusal of a CONNECT, of MQTT 5 or 3.1.1; empty: none.
std::string cure_of_refusal(int code, bool has_user, const SettingNames& names) {
  switch (code) {
    case 1:
      return ": set " + names.version + " to 3.1.1 or 5";
    case MQTTREASONCODE_UNSUPPORTED_PROTOCOL_VERSION:
      return ": set " + names.version + " to 3.1.1";
    case 2:
    case MQTTREASONCODE_CLIENT_IDENTIFIER_NOT_VALID:
      return ": set mqtt.client_id to one that the broker accepts";
    case 4:
    case 5:
    case MQTTREASONCODE_BAD_USER_NAME_OR_PASSWORD:
    case MQTTREASONCODE_NOT_AUTHORIZED:
      return has_user ? ": the broker does not accept " + names.user +
                            " with this password: compare both with the broker's password file"
                      : ": the broker requires a user: set " + names.user + " and " +
                            names.password_file;
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
      return ": the broker refers its clients to another server: put that address into " +
             names.servers;
    case MQTTREASONCODE_CONNECTION_RATE_EXCEEDED:
      return ": too many connections in a short time; the agent retries. If this persists, raise "
             "the broker's limit";
    default:
      return {};
  }
}

/// Returns why the server's certificate was not accepted, and what to do.
std::string distrust(long code, const MqttConfig& config, const SettingNames& names) {
  std::string text =
      std::string("TLS: certificate verify failed: ") + X509_verify_cert_error_string(code);
  if (code == X509_V_ERR_CERT_HAS_EXPIRED || code == X509_V_ERR_CERT_NOT_YET_VALID)
    return text + ": renew it, or set this machine's clock";
  const bool own = config.tls && !config.tls->ca_file.empty();
  return text + (own ? ": " + names.ca_file + " " + config.tls->ca_file +
                           " does not contain the authority that signed the server's certificate"
                     : ": set " + names.ca_file +
                           " to the authority that signed the server's certificate");
}

/// Describes a packet that was rejected; empty: there was none.
std::string refused_packet() {
  const RefusedPacket refused = take_refused_packet();
  if (refused.bytes == 0) return {};
  if (refused.most == 0) return "the server sent a message before its answer to CONNECT";
  return "the broker sent a packet of " + std::to_string(refused.bytes) +
         " bytes; the agent reads at most " + std::to_string(refused.most);
}

}  // namespace

void trace_errors_alone() noexcept { MQTTAsync_setTraceLevel(MQTTASYNC_TRACE_ERROR); }

void trace_tls_failures() noexcept {
  MQTTAsync_setTraceCallback(note_tls_reason);
  MQTTAsync_setTraceLevel(MQTTASYNC_TRACE_MINIMUM);
}

void forget_tls_failure() noexcept { tls_reason.clear(); }

bool is_disconnected(int return_code) {
  return return_code == MQTTASYNC_DISCONNECTED || return_code == MQTTASYNC_OPERATION_INCOMPLETE;
}

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

std::string closed_text() {
  if (std::string refused = refused_packet(); !refused.empty()) return refused;
  return "connection closed: the broker was stopped, the network failed, or another client "
         "connected with this agent's client id (each needs its own agent.id or mqtt.client_id)";
}

FailureText::FailureText(const MqttConfig& config, const SettingNames& names, int version, bool tls)
    : config_(config), names_(names), version_(version), tls_(tls) {}

std::string FailureText::of_refused_topic(int reason_code) const {
  const std::string text = reason_text(reason_code);
  return reason_code == MQTTREASONCODE_NOT_AUTHORIZED ? text + ": " + names_.access : text;
}

int FailureText::refusal_of(const mqtt::token& token) const {
  if (version_ != MQTTVERSION_5) return 0;
  const int reason = static_cast<int>(token.get_reason_code());
  if (reason >= 0x80) return reason;
  const int code = token.get_return_code();
  return code >= 0x80 ? code : 0;
}

std::string FailureText::of_connect(const mqtt::token& token,
                                    std::chrono::steady_clock::time_point since) const {
  const bool has_user = !config_.username.empty();
  if (const int reason = refusal_of(token))
    return reason_text(reason) + cure_of_refusal(reason, has_user, names_);
  const int code = token.get_return_code();
  const std::string_view refusal = connack_text(code);
  if (!refusal.empty()) return std::string(refusal) + cure_of_refusal(code, has_user, names_);
  if (std::string refused = refused_packet(); !refused.empty()) return refused;
  const ConnectFaults faults = connect_faults(since);
  if (faults.lookup != 0)
    return std::string("the host name is not known (") + gai_strerror(faults.lookup) +
           "): is it spelt correctly, and does this machine's name server know it?";
  if (faults.socket == ECONNREFUSED)
    return "connection refused: is the broker running, and is this its port?";
  if (faults.socket != 0)
    return std::string("no way to this address (") + std::strerror(faults.socket) +
           "): is the network up, and is the address right?";
  return tls_ ? of_tls(faults, since) : of_plain(faults, since);
}

std::string FailureText::of_tls(const ConnectFaults& faults,
                                std::chrono::steady_clock::time_point since) const {
  if (faults.certificate != X509_V_OK) return distrust(faults.certificate, config_, names_);
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
                : ": " + set_certificate());
  if (!faults.is_encrypted) return tls_reason.empty() ? kNoAnswer : "TLS: " + tls_reason;
  return std::chrono::steady_clock::now() - since < kPahoConnectTimeout ? cut_after_handshake()
                                                                        : kNoAnswer;
}

std::string FailureText::cut_after_handshake() const {
  const std::string text = "the server ends the connection after the TLS handshake: ";
  const bool has_own = config_.tls && !config_.tls->cert_file.empty();
  return has_own ? text + "it may not accept the certificate of " + names_.cert_file +
                       ": is it still valid, and does the broker trust its authority?"
                 : text + "it may require a certificate: " + set_certificate();
}

std::string FailureText::set_certificate() const {
  return "set " + names_.cert_file + " and " + names_.key_file;
}

std::string FailureText::of_plain(const ConnectFaults& faults,
                                  std::chrono::steady_clock::time_point since) const {
  if (last_closed_by_peer() < since && !faults.speaks_tls) return kNoAnswer;
  if (faults.speaks_tls)
    return "the server answers with TLS: try mqtts://, or the port without TLS";
  if (faults.was_reset)
    return "the server closes the connection before any MQTT packet: is this a broker's port, and "
           "does the broker accept this machine's address? If it is a port with TLS, try mqtts://";
  const std::string closed = "the server accepts the connection and closes it without an answer";
  return version_ == MQTTVERSION_5
             ? closed + "; a broker without MQTT 5 does so: set " + names_.version + " to 3.1.1"
             : closed + ": is it an MQTT broker?";
}

std::string FailureText::of_publish(const mqtt::token& token) const {
  if (const int reason = refusal_of(token)) return of_refused_topic(reason);
  const std::string text = mqtt::exception::error_str(token.get_return_code());
  return text.empty() ? "code " + std::to_string(token.get_return_code()) : text;
}

std::string FailureText::of_subscribe(const mqtt::token& token) const {
  // The only failure code that MQTT 3.1.1 has, section 3.9.3; Paho has no text for it.
  if (version_ != MQTTVERSION_5 && token.get_return_code() == 0x80)
    return "refused by the broker: " + names_.access;
  return of_publish(token);
}

}  // namespace fxagent
