//! The program: parse, run, print the error chain once, exit code.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
