// PahoBroker against a real mosquitto. Every wait ends with an event, or fails after a limit.
#include "agent/uplink/paho/paho_broker.h"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <cstdlib>
#include <deque>
#include <filesystem>
#include <iterator>
#include <mutex>
#include <nlohmann/json.hpp>
#include <stop_token>
#include <thread>

#include "agent/uplink/paho/incoming_packets.h"
#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/publisher.h"
#include "tests/agent/uplink/mosquitto.h"
#include "tests/agent/uplink/plant.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using test::expect_says;
using test::Mosquitto;
using test::Scratch;

constexpr auto kLimit = 20s;

MqttConfig settings(const std::string& url, int version = 5) {
  MqttConfig config;
  config.servers = {url};
  config.version = version;
  static int made = 0;
  config.client_id = "test-" + std::to_string(getpid()) + "-" + std::to_string(++made);
  return config;
}

/// A PahoBroker whose events a test can wait for.
class Client {
 public:
  explicit Client(MqttConfig config,
                  std::optional<Publication> will = retained("will/topic", "gone"),
                  std::size_t max_payload = kMaxMessageBytes, const SettingNames& names = {})
      : broker_(
            config, will ? MakeWill([will] { return *will; }) : MakeWill(),
            [this] {
              const std::lock_guard lock(mutex_);
              news_ = true;
              changed_.notify_one();
            },
            max_payload, std::chrono::seconds(0), names) {}

  PahoBroker* operator->() { return &broker_; }

  /// Returns the next event of this type and drops the events before it. Fails after the limit.
  template <class Event>
  Event next() {
    const auto deadline = std::chrono::steady_clock::now() + kLimit;
    for (;;) {
      while (!events_.empty()) {
        const BrokerEvent event = std::move(events_.front());
        events_.pop_front();
        connections_ += std::holds_alternative<Connected>(event) ? 1 : 0;
        if (const auto* found = std::get_if<Event>(&event)) return *found;
        if (const auto* failed = std::get_if<ConnectFailed>(&event)) seen_ += failed->text + "; ";
      }
      {
        std::unique_lock lock(mutex_);
        if (!changed_.wait_until(lock, deadline, [this] { return news_; }))
          throw std::runtime_error("no such event in time; seen: " + seen_);
        news_ = false;
      }
      for (BrokerEvent& event : broker_.take_events()) events_.push_back(std::move(event));
    }
  }

  /// Waits until there is an event, and leaves it to the broker.
  void await_event() {
    std::unique_lock lock(mutex_);
    EXPECT_TRUE(changed_.wait_for(lock, kLimit, [this] { return news_; }));
  }

  /// The number of Connected events so far.
  int connections() const { return connections_; }

  Connected connect() {
    broker_.connect(0, kReceiveMaximum);
    return next<Connected>();
  }
  std::string refusal() {
    broker_.connect(0, kReceiveMaximum);
    return next<ConnectFailed>().text;
  }
  void subscribe(const std::string& filter) {
    broker_.subscribe({filter, false});
    const auto answer = next<Subscribed>();
    EXPECT_TRUE(answer.granted) << answer.text;
    EXPECT_EQ(answer.filter, filter);
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool news_ = false;
  std::deque<BrokerEvent> events_;
  std::string seen_;
  int connections_ = 0;
  PahoBroker broker_;  // last: its callbacks use the other members
};

/// One that is connected.
struct OnlineClient : Client {
  explicit OnlineClient(MqttConfig config, auto&&... more) : Client(std::move(config), more...) {
    connect();
  }
};

Publication publication(std::uint64_t id, std::string topic, std::string payload) {
  return {.id = id, .topic = std::move(topic), .payload = std::move(payload)};
}

int option(int fd, int level, int name) {
  int value = -1;
  socklen_t length = sizeof(value);
  EXPECT_EQ(getsockopt(fd, level, name, &value, &length), 0);
  return value;
}

/// Returns this process's connections to `port`.
std::vector<int> sockets_towards(std::uint16_t port) {
  std::vector<int> found;
  for (int fd = 3; fd < 256; ++fd) {
    sockaddr_in peer{};
    socklen_t length = sizeof(peer);
    if (getpeername(fd, reinterpret_cast<sockaddr*>(&peer), &length) != 0) continue;
    if (peer.sin_family == AF_INET && ntohs(peer.sin_port) == port) found.push_back(fd);
  }
  return found;
}

TEST(PahoBroker, SmallMessagesDoNotWaitForTheAckOfTheOneBefore) {
  const Mosquitto mosquitto;
  OnlineClient client(settings(mosquitto.url(), 5));
  const std::vector<int> sockets = sockets_towards(mosquitto.port());
  ASSERT_EQ(sockets.size(), 1U);
  EXPECT_EQ(option(sockets[0], IPPROTO_TCP, TCP_NODELAY), 1);
}

/// Another TCP connection of this process to the broker's port.
class OtherConnection final {
 public:
  explicit OtherConnection(std::uint16_t port) {
    sockaddr_in peer{};
    peer.sin_family = AF_INET;
    peer.sin_port = htons(port);
    peer.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (connect(fd_, reinterpret_cast<const sockaddr*>(&peer), sizeof(peer)) != 0)
      throw std::runtime_error("no connection to the broker");
  }
  ~OtherConnection() { close(fd_); }
  OtherConnection(const OtherConnection&) = delete;
  OtherConnection& operator=(const OtherConnection&) = delete;

  int fd() const { return fd_; }

 private:
  const int fd_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
};

/// Connects a client and lets it hold messages: both must set options only on its own socket.
void expect_others_left_alone(const Mosquitto& mosquitto, const MqttConfig& config) {
  const OtherConnection other(mosquitto.port());
  const int room = option(other.fd(), SOL_SOCKET, SO_RCVBUF);
  OnlineClient client(config);
  client->hold_messages(true);
  const std::vector<int> sockets = sockets_towards(mosquitto.port());
  EXPECT_EQ(sockets.size(), 2U);
  for (const int fd : sockets) {
    const bool is_client = fd != other.fd();
    EXPECT_EQ(option(fd, IPPROTO_TCP, TCP_NODELAY), is_client ? 1 : 0);
    EXPECT_EQ(option(fd, SOL_SOCKET, SO_RCVLOWAT) > 1, is_client);
  }
  EXPECT_EQ(option(other.fd(), SOL_SOCKET, SO_RCVBUF), room);
}

TEST(PahoBroker, ReadsOnAfterABurstThatFilledItsInbox) {
  constexpr std::uint64_t kMessages = 60;
  const Mosquitto mosquitto;
  OnlineClient client(settings(mosquitto.url(), 5));
  client.subscribe("a");
  OnlineClient other(settings(mosquitto.url(), 5));
  const std::vector<int> before = sockets_towards(mosquitto.port());
  for (std::uint64_t id = 1; id <= kMessages; ++id)
    other->publish(publication(id, "a", std::string(64'000, 'x')));
  for (std::uint64_t id = 1; id <= kMessages; ++id) other.next<Delivered>();
  const auto paused = [&] {
    return std::ranges::any_of(before,
                               [](int fd) { return option(fd, SOL_SOCKET, SO_RCVLOWAT) > 1; });
  };
  const auto deadline = std::chrono::steady_clock::now() + kLimit;
  while (!paused()) ASSERT_LT(std::chrono::steady_clock::now(), deadline);
  for (std::uint64_t id = 1; id <= kMessages; ++id)
    EXPECT_EQ(client.next<Message>().payload.size(), 64'000U);
  EXPECT_FALSE(paused());
}

class PahoBrokerVersion : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Mqtt, PahoBrokerVersion, testing::Values(4, 5));

TEST_P(PahoBrokerVersion, CarriesMessagesBothWays) {
  const Mosquitto mosquitto;
  Client client(settings(mosquitto.url(), GetParam()));
  const Connected connected = client.connect();
  EXPECT_FALSE(connected.session_present);
  EXPECT_EQ(connected.receive_maximum, GetParam() == 5 ? 20U : 65535U);
  client->publish(publication(6, "elsewhere", ""));
  EXPECT_EQ(client.next<Delivered>().id, 6U);
  EXPECT_EQ(client.connections(), 1) << "a connection is told once";
  client.subscribe("a/+");
  client->publish(publication(7, "a/b", "hello"));
  const auto message = client.next<Message>();
  EXPECT_EQ(message.topic, "a/b");
  EXPECT_EQ(message.payload, "hello");
  EXPECT_FALSE(message.retained);
  EXPECT_NEAR(static_cast<double>(message.received_ms),
              static_cast<double>(utc_ms(std::chrono::system_clock::now())), 60000);
  client->publish(publication(8, "elsewhere", ""));
  while (client.next<Delivered>().id != 8) {
  }
  client->disconnect();
  client.next<Disconnected>();
}

TEST_P(PahoBrokerVersion, SocketsOfOthersAreLeftAlone) {
  const Mosquitto mosquitto;
  expect_others_left_alone(mosquitto, settings(mosquitto.url(), GetParam()));
}

TEST_P(PahoBrokerVersion, Qos0CountsAsDeliveredWhenItIsOnItsWay) {
  const Mosquitto mosquitto;
  OnlineClient client(settings(mosquitto.url(), GetParam()));
  Publication live = publication(5, "a", "x");
  live.qos = 0;
  client->publish(live);
  EXPECT_EQ(client.next<Delivered>().id, 5U);
}

/// A broker that admits only edge7, with password "right".
Mosquitto edge7_only(const Scratch& directory) {
  const std::string users = directory.path("users");
  test::run({"mosquitto_passwd", "-b", "-c", users, "edge7", "right"}, directory.path("log"));
  return Mosquitto("allow_anonymous false\npassword_file " + users);
}

TEST_P(PahoBrokerVersion, WrongPasswordIsSaidAndTheFileIsReadAgain) {
  const Scratch directory;
  const Mosquitto mosquitto = edge7_only(directory);
  MqttConfig config = settings(mosquitto.url(), GetParam());
  config.username = "edge7";
  config.password_file = directory.write("password", "wrong\n");
  setenv("FXAGENT_TEST_PASSWORD", "wrong too", 1);
  config.password_env = "FXAGENT_TEST_PASSWORD";
  Client client(config);
  const std::string text = client.refusal();
  EXPECT_TRUE(text.find("uthori") != std::string::npos ||
              text.find("password") != std::string::npos)
      << text;
  EXPECT_EQ(text.find("wrong"), std::string::npos) << text;
  directory.write("password", "right\r\n");
  client.connect();
}

TEST_P(PahoBrokerVersion, LostConnectionIsToldOnceAndTheNextOneWorks) {
  const std::uint16_t port = test::free_port();
  auto mosquitto = std::make_unique<Mosquitto>("allow_anonymous true", port);
  OnlineClient client(settings(mosquitto->url(), GetParam()));
  client->publish(publication(1, "a", "x"));
  EXPECT_EQ(client.next<Delivered>().id, 1U);
  mosquitto.reset();
  EXPECT_FALSE(client.next<Lost>().text.empty());
  EXPECT_FALSE(client.refusal().empty());
  const Mosquitto again("allow_anonymous true", port);
  client.connect();
  client->publish(publication(2, "a", "x"));
  EXPECT_EQ(client.next<Delivered>().id, 2U);
}

TEST_P(PahoBrokerVersion, BrokerKeepsNoCommandForOneThatWasAway) {
  const Mosquitto mosquitto;
  OnlineClient sender(settings(mosquitto.url()));
  const MqttConfig config = settings(mosquitto.url(), GetParam());
  {
    Client client(config);
    EXPECT_FALSE(client.connect().session_present);
    client.subscribe("press1/command");
    client->disconnect();  // keeps the subscription in the session, if there is one
    client.next<Disconnected>();
  }
  sender->publish(publication(1, "press1/command", "while away"));
  sender.next<Delivered>();
  Client again(config);
  EXPECT_FALSE(again.connect().session_present);
  again.subscribe("press1/#");
  sender->publish(publication(2, "press1/command", "now"));
  EXPECT_EQ(again.next<Message>().payload, "now");
}

TEST(PahoBroker, OwnMessagesDoNotComeBackWhereTheyAreNotWanted) {
  const Mosquitto mosquitto;
  OnlineClient other(settings(mosquitto.url()));
  other.subscribe("a/#");
  OnlineClient client(settings(mosquitto.url()));
  client->subscribe({"a/#", true});
  EXPECT_TRUE(client.next<Subscribed>().granted);
  client->publish(publication(1, "a/b", "its own"));
  EXPECT_EQ(other.next<Message>().payload, "its own");
  other->publish(publication(2, "a/b", "another's"));
  EXPECT_EQ(client.next<Message>().payload, "another's");
}

TEST(PahoBroker, PasswordComesFromTheEnvironmentWhereThereIsNoFile) {
  const Scratch directory;
  const Mosquitto mosquitto = edge7_only(directory);
  MqttConfig config = settings(mosquitto.url());
  config.username = "edge7";
  config.password_env = "FXAGENT_TEST_PASSWORD";
  setenv("FXAGENT_TEST_PASSWORD", "right", 1);
  OnlineClient client(config);
}

TEST(PahoBroker, PasswordOfTheConfigItselfIsUsed) {
  const Scratch directory;
  const Mosquitto mosquitto = edge7_only(directory);
  MqttConfig config = settings(mosquitto.url());
  config.username = "edge7";
  config.password = "right";
  OnlineClient client(config);
}

TEST(PahoBroker, PasswordFileWithoutEndIsRefused) {
  MqttConfig config = settings("mqtt://127.0.0.1:1");
  config.password_file = "/dev/zero";
  expect_says(Client(config).refusal(), "longer than a password");
}

TEST(PahoBroker, MissingSecretIsSaidWithoutAskingTheBroker) {
  MqttConfig config = settings("mqtt://127.0.0.1:1");
  config.password_file = "/nonexistent/secret";
  expect_says(Client(config).refusal(), "/nonexistent/secret: No such file");
  config.password_file.clear();
  config.password_env = "FXAGENT_TEST_NOT_SET";
  expect_says(Client(config).refusal(), "FXAGENT_TEST_NOT_SET");
}

TEST(PahoBroker, PropertiesOfMqtt5AndTheRetainFlagArrive) {
  const Scratch directory;
  const Mosquitto mosquitto;
  OnlineClient client(settings(mosquitto.url()));
  client.subscribe("fx/e/+/command");
  std::istringstream words("mosquitto_pub -V 5 -h 127.0.0.1 -p " +
                           std::to_string(mosquitto.port()) +
                           " -q 1 -r -t fx/e/p/command -m {} -D publish response-topic hmi/r "
                           "-D publish correlation-data c1 -D publish message-expiry-interval 30");
  test::run({std::istream_iterator<std::string>(words), {}}, directory.path("log"));
  const auto message = client.next<Message>();
  EXPECT_TRUE(message.retained);  // Retain As Published: it was delivered live
  EXPECT_EQ(message.response_topic, "hmi/r");
  EXPECT_EQ(message.correlation, (Bytes{'c', '1'}));
  ASSERT_TRUE(message.message_expiry);
  EXPECT_LE(*message.message_expiry, 30s);
  EXPECT_GE(*message.message_expiry, 10s);

  Publication answer = publication(3, "fx/e/x/command", "y");
  answer.correlation = {0, 255, 'z'};
  client->publish(answer);
  EXPECT_EQ(client.next<Message>().correlation, answer.correlation);
}

TEST(PahoBroker, PayloadIsCutOffBehindItsLimit) {
  const Mosquitto mosquitto;
  OnlineClient client(settings(mosquitto.url()));
  client.subscribe("a");
  client->publish(publication(1, "a", std::string(200000, 'x')));
  EXPECT_EQ(client.next<Message>().payload.size(), kMaxMessageBytes + 1);
}

TEST(PahoBroker, LongerPayloadsArriveWhereTheyAreAskedFor) {
  const Mosquitto mosquitto;
  OnlineClient client(settings(mosquitto.url()), std::nullopt, 150000U);
  client.subscribe("a");
  client->publish(publication(1, "a", std::string(100000, 'x')));
  EXPECT_EQ(client.next<Message>().payload.size(), 100000U);
  client->publish(publication(2, "a", std::string(200000, 'x')));
  EXPECT_EQ(client.next<Message>().payload.size(), 150001U);
}

TEST(PahoBroker, RemoteConfigOfTheGreatestSizeArrives) {
  const Mosquitto mosquitto;
  OnlineClient client(settings(mosquitto.url()));
  const std::string topic = "a" + std::string(kDesiredTopic);
  client.subscribe(topic);
  client->publish(publication(1, topic, std::string(kMaxDesiredBytes, 'x')));
  EXPECT_EQ(client.next<Message>().payload.size(), kMaxDesiredBytes);
}

TEST(PahoBroker, RefusedPublishCarriesItsReasonCode) {
  const Scratch directory;
  const std::string acl = directory.write("acl", "topic read #\ntopic write allowed\n");
  const Mosquitto mosquitto("allow_anonymous true\nacl_file " + acl);
  OnlineClient client(settings(mosquitto.url()));
  client->publish(publication(1, "forbidden", "x"));
  const auto failed = client.next<DeliveryFailed>();
  EXPECT_EQ(failed.id, 1U);
  EXPECT_EQ(failed.reason_code, 0x87);
  expect_says(failed.text, "fxagent acl prints");
  client->publish(publication(2, "allowed", "x"));
  EXPECT_EQ(client.next<Delivered>().id, 2U);
}

// ---- a broker that disconnects, or worse -------------------------------------------------------

/// A socket that listens on a free loopback port.
class Listener final {
 public:
  Listener() : fd_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    bind(fd_, reinterpret_cast<const sockaddr*>(&address), size);
    listen(fd_, 5);
    getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
  }
  ~Listener() { close(fd_); }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;
  int fd() const { return fd_; }
  std::string url() const { return "mqtt://127.0.0.1:" + std::to_string(port_); }

 private:
  int fd_;
  std::uint16_t port_ = 0;
};

/// A thread that accepts one client, sends `answer` after its first packet and closes the
/// connection.
std::jthread answer_first_packet(const Listener& listener, std::string_view answer) {
  return std::jthread([&listener, answer] {
    const int client = accept(listener.fd(), nullptr, nullptr);
    char bytes[1000];
    recv(client, bytes, sizeof bytes, 0);
    if (!answer.empty()) send(client, answer.data(), answer.size(), MSG_NOSIGNAL);
    close(client);
  });
}

/// A thread that takes one client and resets the connection (RST) after its first packet, which is
/// returned.
std::jthread reset_first_packet(const Listener& listener, std::string& packet) {
  return std::jthread([&] {
    const int client = accept(listener.fd(), nullptr, nullptr);
    packet.resize(1000);
    packet.resize(static_cast<std::size_t>(
        std::max<ssize_t>(recv(client, packet.data(), packet.size(), 0), 0)));
    const linger at_once{.l_onoff = 1, .l_linger = 0};
    setsockopt(client, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    close(client);
  });
}

/// Serves one client after another on its own thread. Sends CONNACK to each, and `first` after it
/// to the first client only.
class SpitefulServer final {
 public:
  enum class Afterwards : std::uint8_t { closes, stays };

  SpitefulServer(int version, std::string first, Afterwards afterwards)
      : connack_(version == 5 ? std::string("\x20\x03\x00\x00\x00", 5)
                              : std::string("\x20\x02\x00\x00", 4)) {
    thread_ =
        std::thread([this, first = std::move(first), afterwards] { serve(first, afterwards); });
  }
  ~SpitefulServer() {
    shutdown(listener_.fd(), SHUT_RDWR);
    thread_.join();
  }
  SpitefulServer(const SpitefulServer&) = delete;
  SpitefulServer& operator=(const SpitefulServer&) = delete;
  std::string url() const { return listener_.url(); }

 private:
  void serve(const std::string& first, Afterwards afterwards) {
    std::vector<int> clients;
    for (int client = 0; (client = accept(listener_.fd(), nullptr, nullptr)) >= 0;) {
      char bytes[1000];
      std::string words = clients.empty() ? connack_ + first : connack_;
      if (recv(client, bytes, sizeof bytes, 0) > 0)
        send(client, words.data(), words.size(), MSG_NOSIGNAL);
      if (clients.empty() && afterwards == Afterwards::closes) shutdown(client, SHUT_WR);
      clients.push_back(client);
    }
    for (const int client : clients) close(client);
  }

  const Listener listener_;
  const std::string connack_;
  std::thread thread_;
};

using Afterwards = SpitefulServer::Afterwards;

std::string disconnect_packet(int code, const std::string& reason) {
  std::string body(1, static_cast<char>(code));
  if (!reason.empty()) {
    const std::string property =
        std::string("\x1f\x00", 2) + static_cast<char>(reason.size()) + reason;
    body += static_cast<char>(property.size()) + property;
  }
  return std::string("\xe0") + static_cast<char>(body.size()) + body;
}

/// All codes a broker may send in DISCONNECT (MQTT 5, section 3.14.2.1), and two invalid ones.
constexpr int kDisconnectCodes[] = {0x00, 0x04, 0x81, 0x82, 0x83, 0x87, 0x89, 0x8B, 0x8D, 0x8E,
                                    0x8F, 0x90, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9A,
                                    0x9B, 0x9C, 0x9D, 0x9E, 0x9F, 0xA0, 0xA1, 0xA2, 0xFF};

TEST(PahoBroker, DisconnectOfTheBrokerIsALossAndItsReasonIsTold) {
  int number = 0;
  for (const int code : kDisconnectCodes) {
    const std::string reason = ++number % 2 == 0 ? "for a test" : "";
    SCOPED_TRACE("code " + std::to_string(code));
    const SpitefulServer server(5, disconnect_packet(code, reason), Afterwards::stays);
    OnlineClient client(settings(server.url()));
    const Lost lost = client.next<Lost>();
    const std::string& text = lost.text;
    EXPECT_EQ(lost.reason_code, code);
    EXPECT_TRUE(text.starts_with("the broker said: ")) << text;
    EXPECT_GT(text.size(), std::string("the broker said: ").size());
    EXPECT_EQ(text.ends_with(": for a test"), !reason.empty()) << text;
    EXPECT_FALSE(client->is_connected());
  }
}

TEST(PahoBroker, ConnectionAfterADisconnectWorks) {
  for (const std::string reason : {"", "for a test"})
    for (const Afterwards afterwards : {Afterwards::closes, Afterwards::stays}) {
      const SpitefulServer server(5, disconnect_packet(0x98, reason), afterwards);
      OnlineClient client(settings(server.url()));
      client.next<Lost>();
      client.connect();
      EXPECT_TRUE(client->is_connected());
    }
}

TEST_P(PahoBrokerVersion, ServerThatClosesBeforeItsConnackHasAnsweredAllTheSame) {
  const Listener listener;
  const std::jthread server = answer_first_packet(listener, "");
  Client client(settings(listener.url(), GetParam()));
  client->connect(0, kReceiveMaximum);
  const std::string text = client.next<ConnectFailed>().text;
  EXPECT_TRUE(text.starts_with("the server accepts the connection and closes it")) << text;
  EXPECT_EQ(text.find("set mqtt.version to 3.1.1") != text.npos, GetParam() == 5) << text;
}

TEST_P(PahoBrokerVersion, ServerThatResetsTheConnectionIsNamed) {
  const Listener listener;
  std::string connect;
  std::jthread server = reset_first_packet(listener, connect);
  MqttConfig config = settings(listener.url(), GetParam());
  config.keep_alive = 77s;
  const std::string text = Client(config).refusal();
  server.join();
  EXPECT_TRUE(text.starts_with("the server closes the connection before any MQTT packet")) << text;
  const std::size_t at = connect.find("MQTT") + 6;  // behind it version, flags, keep alive
  ASSERT_LT(at + 1, connect.size());
  EXPECT_EQ(connect.substr(at, 2), std::string("\0\x4d", 2)) << "keep_alive of the config";
}

TEST(PahoBroker, ServerThatAnswersWithATlsAlertIsSaidToSpeakTls) {
  const Listener listener;
  const std::jthread server = answer_first_packet(listener, {"\x15\x03\x01\x00\x02\x02\x46", 7});
  const std::string text = Client(settings(listener.url())).refusal();
  expect_says(text, "answers with TLS: try mqtts://");
}

TEST(PahoBroker, EveryRefusalOfAConnectHasACure) {
  for (const char code : {'\x87', '\x88', '\x89', '\x8A', '\x95', '\x97', '\x9C', '\x9D', '\x9F'}) {
    const Listener listener;
    const std::string connack = std::string("\x20\x03\x00", 3) + code + '\0';
    const std::jthread server = answer_first_packet(listener, connack);
    const std::string text = Client(settings(listener.url())).refusal();
    expect_says(text, ": ");
  }
}

TEST_P(PahoBrokerVersion, EveryWayNotToGetThroughHasATextOfItsOwn) {
  const auto refusal = [](const std::string& server) {
    return Client(settings(server, GetParam())).refusal();
  };
  const std::string port = std::to_string(test::free_port());
  EXPECT_TRUE(refusal("mqtt://127.0.0.1:" + port).starts_with("connection refused"));
  EXPECT_TRUE(refusal("mqtts://127.0.0.1:" + port).starts_with("connection refused"));
  const std::string unknown = refusal("mqtt://no-such-host.invalid:1883");
  EXPECT_TRUE(unknown.starts_with("the host name is not known (")) << unknown;
  // The diagnosis of one attempt must not affect the next.
  EXPECT_TRUE(refusal("mqtt://127.0.0.1:" + port).starts_with("connection refused"));
}

TEST_P(PahoBrokerVersion, WrongPasswordAndMissingUserNameTheKeysToSet) {
  const Scratch directory;
  const Mosquitto mosquitto = edge7_only(directory);
  MqttConfig config = settings(mosquitto.url(), GetParam());
  const std::string nobody = Client(config).refusal();
  expect_says(nobody, "set mqtt.username and password_file");
  config.username = "edge7";
  config.password = "left";
  const std::string text = Client(config).refusal();
  expect_says(text, "does not accept mqtt.username with this password");
}

TEST(PahoBroker, TextsHaveTheNamesThatTheCallerGivesItsSettings) {
  const Scratch directory;
  const Mosquitto mosquitto = edge7_only(directory);
  SettingNames names;
  names.user = "--user";
  names.password_file = "--password-file";
  Client client(settings(mosquitto.url()), std::nullopt, kMaxMessageBytes, names);
  expect_says(client.refusal(), "set --user and --password-file");
}

TEST(PahoBroker, SessionTakenOverNamesTheClientId) {
  const SpitefulServer server(5, disconnect_packet(kSessionTakenOver, ""), Afterwards::closes);
  OnlineClient client(settings(server.url()));
  const Lost lost = client.next<Lost>();
  expect_says(lost.text, "Session taken over (another client connected");
}

// Debian's mosquitto does this when it gives the session to another client.
TEST_P(PahoBrokerVersion, CloseWithoutAWordNamesTheClientIdToo) {
  const Mosquitto mosquitto;
  const MqttConfig config = settings(mosquitto.url(), GetParam());
  OnlineClient first(config);
  OnlineClient second(config);
  const Lost lost = first.next<Lost>();
  expect_says(lost.text, "another client connected with this agent's client id");
}

TEST(PahoBroker, DisconnectWithoutACodeIsALossToo) {
  const SpitefulServer server(5, std::string("\xe0\x00", 2), Afterwards::stays);
  OnlineClient client(settings(server.url()));
  EXPECT_EQ(client.next<Lost>().text, "the broker said: normal disconnection");
}

TEST(PahoBroker, LongReasonOfADisconnectIsCutOff) {
  // 300 characters: the lengths take two bytes.
  const std::string packet =
      std::string("\xe0\xb2\x02\x98\xaf\x02\x1f\x01\x2c", 9) + std::string(300, 'x');
  const SpitefulServer server(5, packet, Afterwards::stays);
  OnlineClient client(settings(server.url()));
  const std::string text = client.next<Lost>().text;
  EXPECT_TRUE(text.starts_with("the broker said: Administrative action: xxx")) << text;
  EXPECT_TRUE(text.ends_with("x… (300 bytes)")) << text;
  EXPECT_LE(std::ranges::count(text, 'x'), 128);
}

TEST_P(PahoBrokerVersion, CallThatFindsNoConnectionIsALossToldOnce) {
  const SpitefulServer server(GetParam(), "", Afterwards::closes);
  OnlineClient client(settings(server.url(), GetParam()));
  for (std::uint64_t id = 1; id <= 5; ++id) client->publish(publication(id, "a", "x"));
  client.next<Lost>();
  client->publish(publication(6, "a", "x"));
  client->subscribe({"a", false});
  for (const BrokerEvent& event : client->take_events())
    EXPECT_TRUE(std::holds_alternative<Disconnected>(event)) << event.index();
}

TEST_P(PahoBrokerVersion, PacketThatIsFarTooLongEndsTheConnectionBeforeItIsRead) {
  // The beginning of a packet of 250,000,000 bytes.
  const std::string huge("\x30\x80\xe5\x9a\x77\x00\x01\x61", 8);
  const SpitefulServer server(GetParam(), huge, Afterwards::stays);
  OnlineClient client(settings(server.url(), GetParam()));
  expect_says(client.next<Lost>().text, "a packet of 250000000 bytes");
  client.connect();
}

/// A PUBLISH on topic "a" whose remaining length is `bytes`.
std::string publish_packet(int version, std::size_t bytes) {
  std::string packet(1, '\x30');
  for (std::size_t rest = bytes; rest != 0; rest /= 128)
    packet += static_cast<char>(rest % 128 + (rest >= 128 ? 128 : 0));
  const std::string topic = std::string("\0\1a", 3) + std::string(version == 5 ? 1 : 0, '\0');
  return packet + topic + std::string(bytes - topic.size(), 'x');
}

TEST_P(PahoBrokerVersion, LongestPacketArrivesAndOneByteMoreEndsTheConnection) {
  {
    const SpitefulServer server(GetParam(), publish_packet(GetParam(), kMaxPacketIn),
                                Afterwards::stays);
    OnlineClient client(settings(server.url(), GetParam()));
    EXPECT_EQ(client.next<Message>().payload.size(), kMaxMessageBytes + 1);
  }
  const SpitefulServer server(GetParam(), publish_packet(GetParam(), kMaxPacketIn + 1),
                              Afterwards::stays);
  OnlineClient client(settings(server.url(), GetParam()));
  expect_says(client.next<Lost>().text, "a packet of 16777217 bytes");
}

// ---- TLS ----------------------------------------------------------------------------------------

struct PahoBrokerTls : testing::Test {
  static void SetUpTestSuite() {
    directory_ = std::make_unique<Scratch>();
    test::make_certificates(*directory_, "", "DNS:localhost");
    test::make_certificates(*directory_, "other-", "DNS:localhost");
  }
  static void TearDownTestSuite() { directory_.reset(); }

  static std::string file(const std::string& name) { return directory_->path(name); }
  static std::string listener(const std::string& more = "", const std::string& prefix = "") {
    return "allow_anonymous true\ncafile " + file(prefix + "ca.pem") + "\ncertfile " +
           file(prefix + "server.pem") + "\nkeyfile " + file(prefix + "server.key") + "\n" + more;
  }
  static MqttConfig tls(const std::string& url, const std::string& ca) {
    MqttConfig config = settings(url);
    config.tls = TlsSettings{file(ca), "", ""};
    return config;
  }

  static std::unique_ptr<Scratch> directory_;
};
std::unique_ptr<Scratch> PahoBrokerTls::directory_;

TEST_F(PahoBrokerTls, RightAuthorityAndNameConnect) {
  const Mosquitto mosquitto(listener());
  for (const int version : {4, 5}) {
    MqttConfig config = tls(mosquitto.url("mqtts", "localhost"), "ca.pem");
    config.version = version;
    OnlineClient client(config);
    client->publish(publication(1, "a", "x"));
    EXPECT_EQ(client.next<Delivered>().id, 1U);
  }
}

TEST_F(PahoBrokerTls, SocketsOfOthersAreLeftAlone) {
  const Mosquitto mosquitto(listener());
  expect_others_left_alone(mosquitto, tls(mosquitto.url("mqtts", "localhost"), "ca.pem"));
}

TEST_F(PahoBrokerTls, WillIsSaidForOneThatLeavesWithIt) {
  const Mosquitto mosquitto(listener());
  const MqttConfig config = tls(mosquitto.url("mqtts", "localhost"), "ca.pem");
  OnlineClient observer(config);
  observer.subscribe("will/#");
  MqttConfig other = config;
  other.client_id += "-leaver";
  OnlineClient leaver(other, retained("will/leaver", "gone"));
  leaver->disconnect(Will::published);
  EXPECT_EQ(observer.next<Message>().topic, "will/leaver");
}

TEST_F(PahoBrokerTls, WrongAuthorityReadsAsSuch) {
  const Mosquitto mosquitto(listener());
  const std::string text =
      Client(tls(mosquitto.url("mqtts", "localhost"), "other-ca.pem")).refusal();
  expect_says(text, "certificate verify failed");
  expect_says(text, "mqtt.tls.ca_file " + file("other-ca.pem") + " does not contain the authority");
  const std::string by_system = Client(settings(mosquitto.url("mqtts", "localhost"))).refusal();
  expect_says(by_system, "set mqtt.tls.ca_file to the authority");
}

TEST_F(PahoBrokerTls, PortOfTheOtherKindIsSaidWithTheSchemeToTry) {
  const Mosquitto encrypted(listener());
  for (const int version : {4, 5}) {
    const std::string text =
        Client(settings(encrypted.url("mqtt", "localhost"), version)).refusal();
    expect_says(text, "try mqtts://");
  }
  const Mosquitto plain;
  const std::string text = Client(tls(plain.url("mqtts", "localhost"), "ca.pem")).refusal();
  expect_says(text, "try mqtt://");
}

TEST_F(PahoBrokerTls, CertificateOfAnotherHostIsRefused) {
  const Mosquitto mosquitto(listener());
  const std::string text = Client(tls(mosquitto.url("mqtts", "127.0.0.1"), "ca.pem")).refusal();
  expect_says(text, "is not for this host name: use a host name");
}

TEST_F(PahoBrokerTls, CertificateOfAnAddressIsNotSaidToBeOfAnotherHost) {
  test::make_certificates(*directory_, "address-", "IP:127.0.0.1");
  const Mosquitto mosquitto(listener("require_certificate true", "address-"));
  const std::string text =
      Client(tls(mosquitto.url("mqtts", "127.0.0.1"), "address-ca.pem")).refusal();
  expect_says(text, "set mqtt.tls.cert_file and key_file");
  EXPECT_EQ(text.find("host name"), std::string::npos) << text;
}

TEST_F(PahoBrokerTls, ServerThatResetsTheHandshakeIsNamed) {
  const Listener listener;
  std::string hello;
  const std::jthread server = reset_first_packet(listener, hello);
  std::string url = listener.url();
  url.insert(4, "s");
  const std::string text = Client(tls(url, "ca.pem")).refusal();
  EXPECT_TRUE(text.starts_with("the server ends the TLS handshake")) << text;
}

TEST_F(PahoBrokerTls, MissingFileIsNamed) {
  const Mosquitto mosquitto(listener());
  const std::string text = Client(tls(mosquitto.url("mqtts", "localhost"), "no.pem")).refusal();
  expect_says(text, "no.pem: No such file");
}

TEST_F(PahoBrokerTls, MutualTlsNeedsTheClientsCertificate) {
  const Mosquitto mosquitto(listener("require_certificate true"));
  MqttConfig config = tls(mosquitto.url("mqtts", "localhost"), "ca.pem");
  for (int i = 0; i < 5; ++i) {  // the TLS error depends on timing
    const std::string text = Client(config).refusal();
    expect_says(text, "set mqtt.tls.cert_file and key_file");
  }
  config.tls->cert_file = file("other-client.pem");
  config.tls->key_file = file("other-client.key");
  const std::string text = Client(config).refusal();
  EXPECT_EQ(text.find("host name"), std::string::npos) << text;
  config.tls->cert_file = file("client.pem");
  config.tls->key_file = file("client.key");
  Client(config).connect();
}

// ---- the end of a connection -------------------------------------------------------------------

TEST(PahoBroker, EndsInTheMiddleOfAConnect) {
  const Listener silent;
  for (int i = 0; i < 5; ++i) {
    int server = -1;
    {
      Client client(settings(silent.url()));
      client->connect(0, kReceiveMaximum);
      server = accept(silent.fd(), nullptr, nullptr);
      if (i % 2 == 0) shutdown(server, SHUT_RDWR);
    }
    const timeval limit{std::chrono::seconds(kLimit).count(), 0};
    setsockopt(server, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    char bytes[1000];
    ssize_t count = 0;
    while ((count = recv(server, bytes, sizeof bytes, 0)) > 0) continue;
    EXPECT_TRUE(count == 0 || errno == ECONNRESET) << "the connection outlives the broker object";
    close(server);
  }
}

std::ptrdiff_t open_descriptors() {
  return std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {});
}

TEST(PahoBroker, EndsWithPublishesOnTheirWayAndLeavesNoConnection) {
  const Mosquitto mosquitto;
  std::ptrdiff_t after_the_first = 0;  // without the library's own descriptors
  for (int i = 0; i < 5; ++i) {
    {
      OnlineClient client(settings(mosquitto.url()));
      client.subscribe("a");
      for (std::uint64_t id = 1; id <= 20; ++id) client->publish(publication(id, "a", "x"));
    }
    if (i == 0) after_the_first = open_descriptors();
  }
  EXPECT_EQ(open_descriptors(), after_the_first);
}

TEST(PahoBroker, WillIsSaidForOneThatVanishedAndNotForOneThatLeft) {
  const Scratch directory;
  const Mosquitto mosquitto;
  OnlineClient observer(settings(mosquitto.url()));
  observer.subscribe("will/#");

  OnlineClient polite(settings(mosquitto.url()), retained("will/polite", "gone"));
  polite->disconnect();
  polite.next<Disconnected>();

  setenv("FXAGENT_TEST_VICTIM", mosquitto.url().c_str(), 1);
  const pid_t victim = test::spawn({"/proc/self/exe"}, directory.path("victim.log"));
  EXPECT_EQ(observer.next<Message>().topic, "will/hello");
  kill(victim, SIGKILL);
  waitpid(victim, nullptr, 0);
  const auto will = observer.next<Message>();
  EXPECT_EQ(will.topic, "will/victim");
  EXPECT_EQ(will.payload, "gone");
  EXPECT_TRUE(will.retained);  // Retain As Published
}

TEST_P(PahoBrokerVersion, WillIsSaidForOneThatLeavesWithIt) {
  const Mosquitto mosquitto;
  OnlineClient observer(settings(mosquitto.url(), GetParam()));
  observer.subscribe("will/#");
  OnlineClient leaver(settings(mosquitto.url(), GetParam()), retained("will/leaver", "gone"));
  leaver->publish(publication(1, "will/before", "x"));
  leaver.next<Delivered>();
  leaver.subscribe("to/leaver");
  observer->publish(publication(1, "to/leaver", "x"));
  leaver.await_event();
  leaver->hold_messages(true);
  leaver->disconnect(Will::published);
  EXPECT_FALSE(leaver->is_connected());
  EXPECT_EQ(leaver.next<Message>().topic, "to/leaver") << "what has arrived is not lost";
  leaver.next<Disconnected>();
  EXPECT_EQ(observer.next<Message>().topic, "will/before");
  EXPECT_EQ(observer.next<Message>().topic, "will/leaver");
  EXPECT_EQ(leaver.connect().session_present, false) << "and it can come back";
}

TEST(PahoBroker, CarriesTheWholeUplink) {
  const Mosquitto mosquitto;
  Config config = test::plant();
  config.mqtt = settings(mosquitto.url());
  const std::string base = config.base_topic();
  OnlineClient observer(settings(mosquitto.url()));
  observer.subscribe(base + "/#");

  Outbox outbox(100);
  JsonPayload payload(config, "9f3c21aa", "0.1.0");
  PahoBroker broker(
      config.mqtt, [&payload] { return payload.last_will(); }, [&outbox] { outbox.notify(); });
  Commands commands(config, [&outbox](AdmittedCommand admitted) {
    CommandResult result = test::succeeded(admitted.command.id);
    result.device = admitted.command.device;
    result.received = admitted.command.received;
    outbox.push(std::move(result));
  });
  const PublisherSettings described{.boot = "9f3c21aa", .version = "0.1.0"};
  Publisher publisher(config, described, payload, outbox, broker, commands,
                      [] { return utc_ms(std::chrono::system_clock::now()); });
  std::stop_source stop;
  std::thread thread([&] { run_uplink(publisher, outbox, stop.get_token()); });
  const auto next_on = [&observer](const std::string& topic) {
    for (;;) {
      const auto message = observer.next<Message>();
      if (message.topic == topic) return json::parse(message.payload);
    }
  };
  EXPECT_EQ(next_on(base + "/state")["state"], "online");
  EXPECT_TRUE(next_on(base + "/press2/meta").contains("tags"));
  outbox.push(test::sample(1));
  EXPECT_EQ(next_on(base + "/press1/data/fast")["seq"], 1);
  observer->publish(publication(1, base + "/press2/command",
                                R"({"id":"c1","op":"write","tag":"setpoint","value":50})"));
  const auto result = next_on(base + "/press2/result");
  EXPECT_EQ(result["id"], "c1");
  EXPECT_EQ(result["status"], "SUCCEEDED");
  EXPECT_LT(result["t"]["total_ms"], 5000);
  stop.request_stop();
  EXPECT_EQ(next_on(base + "/state")["reason"], "stopped");
  thread.join();
}

/// The other process of the test above: connects and waits to be killed.
int be_the_victim(const std::string& url) {
  unsetenv("FXAGENT_TEST_VICTIM");
  OnlineClient victim(settings(url), retained("will/victim", "gone"));
  victim->publish(publication(1, "will/hello", "x"));
  for (;;) pause();
}

}  // namespace
}  // namespace fxagent

/// Paho shuts down with its last client and starts again with the next. A thread of Paho that still
/// runs writes to its trace in between and leaks it, 124,800 bytes at a time. The agent keeps its
/// last client until it has the next one, so its own leaks are checked without this suppression.
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() { return "leak:libpaho-mqtt3as.so"; }

int main(int argc, char** argv) {
  if (const char* url = std::getenv("FXAGENT_TEST_VICTIM")) return fxagent::be_the_victim(url);
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
