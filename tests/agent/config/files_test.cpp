#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <future>

#include "agent/config/loader.h"
#include "agent/config/machine.h"
#include "tests/agent/config/small_plant.h"
#include "tests/support/says.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using namespace test;
namespace fs = std::filesystem;

/// Each test has its own directory, deleted afterwards.
struct ConfigFiles : testing::Test {
  std::string write(const std::string& name, std::string_view text) const {
    return scratch_.write(name, text);
  }

  const Scratch scratch_;
  const fs::path& directory_ = scratch_.directory();
};

std::vector<std::string> pointers(const std::vector<ConfigError>& errors) {
  std::vector<std::string> list;
  for (const ConfigError& error : errors) list.push_back(error.pointer);
  return list;
}

TEST_F(ConfigFiles, FileIsReadFromDisk) {
  const auto config = load_config(write("agent.json", small_plant().dump()));
  ASSERT_TRUE(config) << listed(config.error());
  EXPECT_EQ(config->id, "edge7");
}

TEST_F(ConfigFiles, FileThatIsNotThereIsOneErrorWithoutALine) {
  const auto errors = error_of(load_config((directory_ / "none.json").string()));
  expect_error(errors, "", {"No such file"});
  EXPECT_EQ(errors.at(0).line, 0);
}

TEST_F(ConfigFiles, DirectoryIsNoFile) {
  expect_error(error_of(load_config(directory_.string())), "", {"directory"});
}

TEST_F(ConfigFiles, FileWithoutEndIsRefused) {
  expect_error(error_of(load_config("/dev/zero")), "", {"64 MiB"});
}

/// A reload reads the file on a thread with other duties.
TEST_F(ConfigFiles, PipeInPlaceOfTheFileHoldsNobody) {
  const std::string pipe = (directory_ / "agent.json").string();
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  auto read = std::async(std::launch::async, [&] { return read_config_file(pipe); });
  const bool came_back = read.wait_for(std::chrono::seconds(30)) == std::future_status::ready;
  // Releases a blocked reader, because the test could not end otherwise.
  if (!came_back) ::close(::open(pipe.c_str(), O_WRONLY));
  ASSERT_TRUE(came_back);
  expect_error(error_of(read.get()), "", {"pipe", "no program writes"});
}

TEST_F(ConfigFiles, PipeThatIsWrittenIsRead) {
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe(ends.data()), 0);
  // Larger than a pipe's buffer.
  const std::string text(200'000, 'x');
  auto writer = std::async(std::launch::async, [&] {
    for (std::size_t at = 0; at < text.size();) {
      const auto put = ::write(ends[1], text.data() + at, text.size() - at);
      if (put <= 0) break;
      at += static_cast<std::size_t>(put);
    }
    ::close(ends[1]);
  });
  const auto read = read_config_file("/dev/fd/" + std::to_string(ends[0]));
  ::close(ends[0]);
  writer.get();
  ASSERT_TRUE(read) << listed(read.error());
  EXPECT_TRUE(*read == text) << read->size();
}

TEST_F(ConfigFiles, ProcessEnvironmentIsUsed) {
  ::setenv("FXAGENT_TEST_ID", "from-environment", 1);
  const auto config =
      load_config(write("agent.json", changed("/agent/id", R"("${FXAGENT_TEST_ID}")")));
  ::unsetenv("FXAGENT_TEST_ID");
  ASSERT_TRUE(config) << listed(config.error());
  EXPECT_EQ(config->id, "from-environment");
}

TEST_F(ConfigFiles, RelativePathsCountFromTheFilesDirectory) {
  auto plant = small_plant();
  plant["store"]["path"] = "store";
  plant["recorder"] = {{"path", "recordings"}};
  plant["mqtt"]["password_file"] = "secret";
  plant["mqtt"]["servers"][0] = "mqtts://a";
  plant["mqtt"]["tls"] = {{"ca_file", "/etc/ca.pem"}, {"cert_file", "c"}, {"key_file", "k"}};
  const auto config = load_config(write("agent.json", plant.dump()));
  ASSERT_TRUE(config) << listed(config.error());
  EXPECT_EQ(config->store.path, (directory_ / "store").string());
  EXPECT_EQ(config->recorder->path, (directory_ / "recordings").string());
  EXPECT_EQ(config->mqtt.password_file, (directory_ / "secret").string());
  EXPECT_EQ(config->mqtt.tls->ca_file, "/etc/ca.pem");
  EXPECT_EQ(config->mqtt.tls->key_file, (directory_ / "k").string());
}

TEST_F(ConfigFiles, WhatThisMachineLacksIsNamed) {
  auto plant = small_plant();
  const std::string here = directory_.string();
  plant["store"]["path"] = write("file", "") + "/store";
  plant["recorder"]["path"] = here + "/file/recordings";
  plant["mqtt"]["password_file"] = here + "/none";
  plant["mqtt"]["servers"][0] = "mqtts://a";
  plant["mqtt"]["tls"] = {
      {"ca_file", here + "/ca"}, {"cert_file", here + "/c"}, {"key_file", here + "/k"}};
  const auto missing = check_files(good(plant.dump()));
  EXPECT_EQ(pointers(missing), (std::vector<std::string>{
                                   "/mqtt/tls/ca_file", "/mqtt/tls/cert_file", "/mqtt/tls/key_file",
                                   "/mqtt/password_file", "/store/path", "/recorder/path"}))
      << listed(missing);
}

TEST_F(ConfigFiles, DirectoryInPlaceOfAFileIsNamed) {
  auto plant = small_plant();
  plant["mqtt"]["password_file"] = directory_.string();
  fs::permissions(directory_, fs::perms(0755));
  expect_error(check_files(good(plant.dump())), "/mqtt/password_file", {"Is a directory"});
  EXPECT_TRUE(weak_secrets(good(plant.dump())).empty()) << "nobody shall chmod 600 a directory";
}

TEST_F(ConfigFiles, EmptyPasswordFileIsNamed) {
  auto plant = small_plant();
  for (const std::string text : {"", "\n", "\r\n"}) {
    const std::string secret = write("secret", text);
    fs::permissions(secret, fs::perms(0600));
    plant["mqtt"]["password_file"] = secret;
    expect_error(weak_secrets(good(plant.dump())), "/mqtt/password_file", {"is empty"});
  }
}

TEST_F(ConfigFiles, NothingIsNamedWhereAllIsThere) {
  auto plant = small_plant();
  plant["store"]["path"] = (directory_ / "new" / "store").string();
  plant["recorder"]["path"] = (directory_ / "new" / "recordings").string();
  plant["mqtt"]["password_file"] = write("secret", "x");
  plant["mqtt"]["servers"][0] = "mqtts://a";
  plant["mqtt"]["tls"] = {{"ca_file", write("ca", "x")}};
  const auto missing = check_files(good(plant.dump()));
  EXPECT_TRUE(missing.empty()) << listed(missing);
  EXPECT_FALSE(fs::exists(directory_ / "new")) << "a check changes nothing";
}

TEST_F(ConfigFiles, PasswordInClearWantsAFileOfTheOwnersAlone) {
  auto plant = small_plant();
  plant["mqtt"]["password"] = "hunter2";
  const std::string path = write("agent.json", plant.dump());
  for (const unsigned mode : {0644U, 0640U, 0604U, 0610U}) {
    fs::permissions(path, fs::perms(mode));
    const auto config = load_config(path);
    ASSERT_FALSE(config) << mode;
    expect_error(config.error(), "/mqtt/password", {"chmod 600"});
  }
  for (const unsigned mode : {0600U, 0400U}) {
    fs::permissions(path, fs::perms(mode));
    const auto config = load_config(path);
    ASSERT_TRUE(config) << listed(config.error());
    EXPECT_EQ(config->mqtt.password, "hunter2");
  }
}

TEST_F(ConfigFiles, SecretsThatOthersCanReadAreNamed) {
  auto plant = small_plant();
  const std::string secret = write("secret", "x");
  const std::string key = write("key", "x");
  plant["mqtt"]["servers"][0] = "mqtts://a";
  plant["mqtt"]["password_file"] = secret;
  plant["mqtt"]["tls"] = {{"cert_file", write("cert", "x")}, {"key_file", key}};
  const Config config = good(plant.dump());
  const auto with = [&](unsigned secret_mode, unsigned key_mode) {
    fs::permissions(secret, fs::perms(secret_mode));
    fs::permissions(key, fs::perms(key_mode));
    return weak_secrets(config);
  };
  EXPECT_TRUE(with(0600, 0400).empty());
  EXPECT_TRUE(with(0444, 0644).empty()) << "the directory lets nobody pass";
  fs::permissions(directory_, fs::perms(0755));
  expect_error(with(0644, 0600), "/mqtt/password_file", {"everybody", "chmod 600"});
  expect_error(with(0444, 0600), "/mqtt/password_file", {"everybody"});
  expect_error(with(0600, 0640), "/mqtt/tls/key_file", {"its group"});
  EXPECT_EQ(with(0644, 0644).size(), 2U);
  ::setenv("CREDENTIALS_DIRECTORY", directory_.c_str(), 1);
  EXPECT_TRUE(with(0440, 0440).empty()) << "systemd's own access lists";
  ::unsetenv("CREDENTIALS_DIRECTORY");
  fs::remove(secret);
  fs::remove(key);
  EXPECT_TRUE(weak_secrets(config).empty()) << "check_files() tells of those";
}

TEST_F(ConfigFiles, TokensThatCanBeGuessedAreNamedByTheirLine) {
  const auto with = [&](const std::string& tokens) {
    auto plant = small_plant();
    plant.erase("metrics");
    plant["http"] = {{"listen", "127.0.0.1:8080"}, {"token_file", write("token", tokens)}};
    fs::permissions(directory_ / "token", fs::perms(0600));
    return weak_secrets(good(plant.dump()));
  };
  const std::string long_one = "0123456789abcdef";
  for (const std::string& tokens : {long_one, "anna " + long_one, "# short\n\nanna " + long_one,
                                    "anna " + long_one + " # press shop"})
    EXPECT_TRUE(with(tokens + "\n").empty()) << tokens;
  expect_error(with("anna " + long_one + "\nbert\n"), "/http/token_file",
               {"line 2", "fewer than 16 characters", "NAME TOKEN or TOKEN"});
  expect_error(with("anna secret\n"), "/http/token_file", {"line 1"});
  expect_error(with("bob three words here1234567\n"), "/http/token_file",
               {"line 1", "more than a name and a token"});
  expect_error(with("anna " + long_one + "\n\nbert " + long_one + "\n"), "/http/token_file",
               {"line 3", "the token of line 1"});
  EXPECT_EQ(with("anna secret\nbob three words here1234567\nbert secret\n").size(), 3U);
}

TEST_F(ConfigFiles, PasswordFileGoesBeforeTheVariable) {
  auto plant = small_plant();
  plant["store"]["path"] = directory_.string();
  plant["mqtt"]["password_env"] = "FXAGENT_TEST_PASSWORD";
  EXPECT_EQ(pointers(check_files(good(plant.dump()))),
            std::vector<std::string>{"/mqtt/password_env"});
  plant["mqtt"]["password_file"] = (directory_ / "none").string();
  EXPECT_EQ(pointers(check_files(good(plant.dump()))),
            std::vector<std::string>{"/mqtt/password_file"});
  ::setenv("FXAGENT_TEST_PASSWORD", "x", 1);
  EXPECT_EQ(pointers(check_files(good(plant.dump()))),
            std::vector<std::string>{"/mqtt/password_file"})
      << "the agent reads the file";
  plant["mqtt"].erase("password_file");
  const auto missing = check_files(good(plant.dump()));
  ::unsetenv("FXAGENT_TEST_PASSWORD");
  EXPECT_TRUE(missing.empty()) << listed(missing);
}

}  // namespace
}  // namespace fxagent
