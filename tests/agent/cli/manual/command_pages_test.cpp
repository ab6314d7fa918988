#include "agent/cli/manual/command_pages.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "agent/cli/manual/schema.h"

namespace fxagent::test {
namespace {

/// A command line with two subcommands and one option of each kind.
struct CommandPagesTest : ::testing::Test {
  CommandPagesTest() {
    app.set_version_flag("--version", "9");
    CLI::App* read = app.add_subcommand("read-it", "Read a device");
    read->add_option("CONFIG", text, "Config file")->required();
    read->add_option("--count", count, "Devices in a row")->check(CLI::Range(1, 9));
    read->add_flag("-j,--json", flag, ".json \\ printed");
    app.add_subcommand("stop", "Stop it");
  }
  static bool has(const std::string& page, const std::string& part) {
    return page.find(part) != std::string::npos;
  }

  CLI::App app{"tool: does it", "tool"};
  std::string text;
  int count = 0;
  bool flag = false;
};

TEST_F(CommandPagesTest, PageOfTheProgramNamesItsSubcommands) {
  const std::string page = man_page(app, nullptr, "1.2");
  EXPECT_TRUE(page.starts_with(".TH TOOL 1 \"\" \"tool 1.2\"")) << page;
  EXPECT_TRUE(has(page, ".SH NAME\ntool \\- does it\n")) << page;
  EXPECT_TRUE(has(page, ".TP\n\\fBread\\-it\\fR\nRead a device\n")) << page;
  EXPECT_TRUE(has(page, ".TP\n\\fB\\-\\-version\\fR\n")) << page;
  EXPECT_TRUE(has(page, ".BR tool\\-read\\-it (1),\n.BR tool\\-stop (1)\n")) << page;
}

TEST_F(CommandPagesTest, PageOfASubcommandHasEachArgumentAndOption) {
  const std::string page = man_page(app, app.get_subcommand("read-it"), "1.2");
  EXPECT_TRUE(has(page, ".TH TOOL\\-READ\\-IT 1")) << page;
  EXPECT_TRUE(has(page, "tool\\-read\\-it \\- Read a device\n")) << page;
  EXPECT_TRUE(has(page, ".B tool read\\-it\n[\\fIOPTIONS\\fR]\n.I CONFIG\n")) << page;
  EXPECT_TRUE(has(page, ".SH ARGUMENTS\n.TP\n\\fICONFIG\\fR\nConfig file\n")) << page;
  EXPECT_TRUE(has(page, "\\fB\\-\\-count\\fR \\fIINT\\fR\nDevices in a row (INT in [1 \\- 9])\n"))
      << page;
  EXPECT_TRUE(has(page, "\\fB\\-j\\fR, \\fB\\-\\-json\\fR\n\\&.json \\e printed\n")) << page;
}

TEST_F(CommandPagesTest, FooterBecomesSections) {
  app.get_subcommand("stop")->footer("Examples:\n  tool stop -x\nSignals:\n  SIGHUP  again");
  const std::string page = man_page(app, app.get_subcommand("stop"), "1.2");
  EXPECT_TRUE(
      has(page, ".SH EXAMPLES\n.nf\ntool stop \\-x\n.fi\n.SH SIGNALS\n.nf\nSIGHUP  again\n.fi\n"))
      << page;
}

TEST(CommandHelp, PagesOfTheProgramAndOfCheckHaveWhatOthersDoNot) {
  CLI::App app{"fxagent: agent", "fxagent"};
  for (const char* name :
       {"run",      "check",     "doctor",        "scan",   "config",   "plan",   "read",   "write",
        "force-on", "force-off", "verify-stream", "acl",    "audit",    "import", "export", "init",
        "schema",   "decode",    "record",        "replay", "describe", "fleet"})
    app.add_subcommand(name, "Does it");
  add_footers(app);
  const auto count = [](const std::string& page, const std::string& part) {
    int found = 0;
    for (auto at = page.find(part); at != std::string::npos; at = page.find(part, at + 1)) ++found;
    return found;
  };
  const std::string program = man_page(app, nullptr, "1");
  EXPECT_EQ(count(program, ".SH EXAMPLES\n.nf\nfxagent init /etc/fxagent\n"), 1) << program;
  EXPECT_EQ(count(program, ".SH SIGNALS\n.nf\nSIGTERM, SIGINT "), 1) << program;
  EXPECT_EQ(count(program, ".SH EXIT STATUS\n0: done."), 1) << program;
  const std::string check = man_page(app, app.get_subcommand("check"), "1");
  EXPECT_EQ(count(check, ".SH EXIT STATUS\n"), 1) << check;
  EXPECT_EQ(count(check, "\n3  \\-\\-online: another process uses a link"), 1) << check;
  EXPECT_EQ(count(check, "\n4  \\-\\-online: everything answers, and something does not"), 1)
      << check;
}

TEST_F(CommandPagesTest, ConfigPageHasKeysOfTheTableAndOfTheProtocols) {
  const std::string page = config_page("1.2");
  EXPECT_TRUE(page.starts_with(".TH FXAGENT.JSON 5 ")) << page.substr(0, 100);
  EXPECT_TRUE(has(page, ".SH \"links[].serial\"\n")) << "a section";
  EXPECT_TRUE(has(page, "\\fBparity\\fR: none | even | odd (default: ")) << "a choice";
  EXPECT_TRUE(has(page, ".SH \"devices[] with protocol modbus\\-rtu\"\n")) << "a protocol";
  EXPECT_FALSE(has(page, "`"));
}

/// Returns bash's completions for the last of `words`; `tool` has a config with two devices.
std::string offered(const std::string& script, const std::string& words) {
  const auto file =
      std::filesystem::temp_directory_path() / ("fxagent-bash-" + std::to_string(::getpid()));
  std::ofstream(file)
      << script << R"(
tool() { printf '%s\n' device,name,address press1,temp,D100 press1,speed,D101 meter,power,hr:0 '# {}'; }
COMP_WORDS=()"
      << words << R"(); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _fxagent; echo "${COMPREPLY[*]}")";
  std::string out;
  FILE* pipe = ::popen(("bash " + file.string()).c_str(), "r");
  for (int c = 0; (c = std::fgetc(pipe)) != EOF;) out += static_cast<char>(c);
  ::pclose(pipe);
  std::filesystem::remove(file);
  return out;
}

TEST_F(CommandPagesTest, CompletionOffersProtocolsFormatsDevicesAndTags) {
  CLI::App* decode = app.add_subcommand("decode", "Explain");
  decode->add_option("PROTOCOL", text);
  CLI::App* load = app.add_subcommand("import", "Import");
  load->add_option("FORMAT", text);
  load->add_option("--protocol", text);
  app.get_subcommand("read-it")->add_option("DEVICE", text);
  app.get_subcommand("read-it")->add_option("ADDRESS", text);
  const std::string script = bash_completion(app);
  EXPECT_EQ(offered(script, "tool decode modbus-r"), "modbus-rtu\n");
  EXPECT_EQ(offered(script, "tool import --protocol mc-3"), "mc-3e mc-3c\n");
  EXPECT_EQ(offered(script, "tool import kep"), "kepware\n");
  EXPECT_EQ(offered(script, "tool read-it --count 3 a.json ''"), "meter press1\n");
  EXPECT_EQ(offered(script, "tool read-it a.json press1 --json ''"), "temp speed\n");
  EXPECT_EQ(offered(script, "tool read-it --count ''"), "\n");
}

TEST_F(CommandPagesTest, CompletionKnowsSubcommandsOptionsAndWhichTakeAValue) {
  const std::string script = bash_completion(app);
  EXPECT_TRUE(has(script, "words='read-it stop -h --help --version'")) << script;
  EXPECT_TRUE(has(
      script, "read-it) words='-h --help --count -j --json' valued='--count' places='CONFIG' ;;"))
      << script;
  EXPECT_TRUE(has(script, "complete -o default -F _fxagent tool\n")) << script;
}

TEST_F(CommandPagesTest, EachPageIsAFile) {
  const auto directory =
      std::filesystem::temp_directory_path() / ("fxagent-pages-" + std::to_string(::getpid()));
  std::filesystem::create_directory(directory);
  const std::string place = directory.string();
  const char* const asked[] = {"tool", "--help-pages", place.c_str()};
  EXPECT_EQ(write_command_pages(app, 3, asked, "1"), 0);
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(directory))
    names.insert(entry.path().filename().string());
  EXPECT_EQ(names, (std::set<std::string>{"tool.1", "tool-read-it.1", "tool-stop.1", "tool.bash",
                                          "tool.json.5"}));
  std::filesystem::remove_all(directory);
  EXPECT_EQ(write_command_pages(app, 3, asked, "1"), 1) << "the directory is gone";
}

TEST_F(CommandPagesTest, OnlyItsOwnQuestionIsAnswered) {
  const char* const others[] = {"tool", "stop"};
  EXPECT_FALSE(write_command_pages(app, 2, others, "1"));
  EXPECT_FALSE(write_command_pages(app, 1, others, "1"));
  const char* const wrong[] = {"tool", "--help-pages"};
  EXPECT_EQ(write_command_pages(app, 2, wrong, "1"), 2);
}

}  // namespace
}  // namespace fxagent::test
